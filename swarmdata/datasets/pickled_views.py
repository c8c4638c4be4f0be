"""A dataset's view on its way to another process: by its folder, and by maps of what was computed.

A reobservation and other rewards are in files without a name. A process of this machine maps these
files as long as the first one keeps them; any other one computes them again, bit for bit.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

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
    weights: Rewards | None  # of other rewards
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
        None if dataset.reweighting is None else dataset.reweighting.weights,
        computed,
    )
    return restored, (view,)


def restored(view: PickledView) -> "Dataset":
    """Opens the dataset of a view in this process.

    Raises:
        ChecksumError: another dataset is in its folder now.
        DatasetError: the folder cannot be used.
    """
    # imported late: compiled code, rarely needed
    from swarmdata.datasets.dataset import Dataset  # noqa: PLC0415
    from swarmdata.datasets.reobservation import Reobservation  # noqa: PLC0415
    from swarmdata.datasets.reweighting import Reweighting  # noqa: PLC0415

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
        return again if view.weights is None else again.with_rewards(**dict(view.weights))
    stored, reobservation, reweighting = recorded.with_arrays(arrays), None, None
    if view.spec is not None:
        reobservation = Reobservation(recorded, view.spec, stored.arrays)
    if view.weights is not None:
        weights = task_of(recorded.recipe, "reweighting").rules.rewards
        reweighting = Reweighting(stored, weights, view.weights)
    return Dataset(stored, **view.fields, reobservation=reobservation, reweighting=reweighting)
