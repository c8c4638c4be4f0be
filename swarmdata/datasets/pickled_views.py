"""A dataset's view on its way to another process: by its folder, and by maps of what was computed.

A process of this machine maps the files of what was computed as long as the first one keeps them;
any other one computes it again, bit for bit, but for the rewards of a function.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.specs.origins import task_of
from swarmdata.specs.rules import Rewards
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.scratch_arrays import SharedArray, map_shared, share
from swarmdata.store.stored_dataset import reopen_store

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset

Carried = dict[str, SharedArray | NDArray[Any] | None]
"""Computed arrays by name: where they are, or the few numbers of each episode; None: nowhere."""


class PickledView(NamedTuple):
    """Everything that makes a view again."""

    path: Path
    digest: str
    fields: Mapping[str, Any]  # of the `Dataset`, but its files and what was computed
    spec: TaskSpec | None  # of a reobservation
    rewards: Rewards | str | None  # weights of other rewards, or the function that gave them
    computed: Carried


def pickled(dataset: "Dataset") -> tuple[Callable[[PickledView], "Dataset"], tuple[PickledView]]:
    """Returns what `Dataset.__reduce__` has to."""
    computed: Carried = {
        name: array if name.startswith("episodes/") else share(array) if array.size else array
        for name, array in dataset.stored.computed().items()
    }
    view = PickledView(
        dataset.path,
        dataset.digest,
        {name: getattr(dataset, name) for name in ("selection", "references", "source")},
        None if dataset.reobservation is None else dataset.reobservation.spec,
        _origin_of_rewards(dataset),
        computed,
    )
    return restored, (view,)


def _origin_of_rewards(dataset: "Dataset") -> Rewards | str | None:
    """The weights of other rewards, or the function that gave them; None for the recorded."""
    from swarmdata.datasets.reweighting import Relabeling, Reweighting  # noqa: PLC0415  (as below)

    found = dataset.reweighting
    if isinstance(found, Reweighting):
        return found.weights
    return found.function if isinstance(found, Relabeling) else None


def restored(view: PickledView) -> "Dataset":
    """Opens the dataset of a view in this process.

    Raises:
        ChecksumError: another dataset is in its folder now.
        SchemaError: it has rewards of a function, and the process that called it has ended.
        DatasetError: the folder cannot be used.
    """
    # imported late: compiled code, rarely needed
    from swarmdata.datasets.dataset import Dataset  # noqa: PLC0415
    from swarmdata.datasets.reobservation import Reobservation  # noqa: PLC0415
    from swarmdata.datasets.reweighting import OtherRewards, Relabeling, Reweighting  # noqa: PLC0415

    recorded = reopen_store(view.path, view.digest, {})
    mapped = {
        name: map_shared(each) if isinstance(each, SharedArray) else each
        for name, each in view.computed.items()
    }
    arrays = {name: array for name, array in mapped.items() if array is not None}
    for array in arrays.values():
        array.setflags(write=False)
    if len(arrays) < len(mapped):
        again = Dataset(recorded, **view.fields)
        if view.spec is not None:
            models = view.spec.observation, view.spec.communication
            again = again.reobserve(*models, progress=False)
        if isinstance(view.rewards, str):
            raise SchemaError(
                f"the rewards of {again!r} were computed by the function {view.rewards} in another "
                "process, which has ended or runs on another machine. Open the dataset here, and "
                "call `with_rewards` again."
            )
        return again if view.rewards is None else again.with_rewards(**dict(view.rewards))
    stored, reobservation = recorded.with_arrays(arrays), None
    if view.spec is not None:
        reobservation = Reobservation(recorded, view.spec, stored.arrays)
    rewards: OtherRewards | None = None
    if isinstance(view.rewards, str):
        rewards = Relabeling(stored, view.rewards)
    elif view.rewards is not None:
        recorded_weights = task_of(recorded.recipe, "reweighting").rules.rewards
        rewards = Reweighting(stored, recorded_weights, view.rewards)
    return Dataset(stored, **view.fields, reobservation=reobservation, reweighting=rewards)
