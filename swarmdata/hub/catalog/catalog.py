"""How an id becomes an open dataset: from the cache, else a remote, else built from its recipe."""

import warnings
from collections.abc import Callable, Container, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError, list_of
from swarmdata.hub.catalog.identity import judge, misnamed
from swarmdata.hub.catalog.request import Request, cached, is_offline, parse_request
from swarmdata.registry.published import Reference, references_of
from swarmdata.runtime.own_components import import_function
from swarmdata.specs.model_choice import Source, check_messages, with_models
from swarmdata.specs.origins import Origin
from swarmdata.specs.rules import changed_weights, chosen_weights
from swarmdata.store import open_store
from swarmdata.store.stored_dataset import Verify, check_spec

if TYPE_CHECKING:  # a cached dataset is opened without them
    from swarmdata.datasets.mixture import Mixture
    from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset
    from swarmdata.specs.rules import RewardChoice


OPEN_AGAIN = (
    "Pass its id or path, and models, rewards or a side as arguments; swarmdata.filter_dataset "
    "makes a dataset of a subset."
)
"""What to do about an open dataset where the name of one is expected."""


class RebuiltDifferentlyWarning(UserWarning):
    """A dataset that was built on this machine does not have the published digest."""


class AnotherDatasetWarning(UserWarning):
    """A dataset has the id of a published one and is another, or its folder is named like one."""


@overload
def load(
    dataset_id: str | Path,
    *,
    observation: Source | None = None,
    communication: Source | None = None,
    rewards: "RewardChoice | None" = None,
    side: str | None = None,
    path: Path | str | None = None,
    verify: Verify = "fast",
    offline: bool | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> Dataset: ...
@overload
def load(
    dataset_id: str | Path,
    *,
    stream: "Literal[True] | Stream",
    observation: Source | None = None,
    communication: Source | None = None,
    offline: bool | None = None,
    progress: bool = True,
) -> "StreamedDataset": ...
@overload
def load(
    dataset_id: list[str] | list[Path] | tuple[str | Path, ...],
    *,
    weights: Sequence[float] | None = None,
    stream: "bool | Stream" = False,
    observation: Source | None = None,
    communication: Source | None = None,
    rewards: "RewardChoice | None" = None,
    side: str | None = None,
    verify: Verify = "fast",
    offline: bool | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> "Mixture": ...
def load(
    dataset_id: str | Path | list[str] | list[Path] | tuple[str | Path, ...],
    *,
    weights: Sequence[float] | None = None,
    stream: "bool | Stream" = False,
    observation: Source | None = None,
    communication: Source | None = None,
    rewards: "RewardChoice | None" = None,
    side: str | None = None,
    path: Path | str | None = None,
    verify: Verify = "fast",
    offline: bool | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> "Dataset | Mixture | StreamedDataset":
    """Opens a dataset, or a mixture of several: from the cache, a remote, or built from its recipe.

    The remotes that are configured are asked in order (`swarmdata remote list`); one that fails, or
    has another dataset than the published one, is skipped with a warning. `source` of the result
    says what happened: `cache`, `folder`, `rebuilt`, or the address it was fetched from. Several
    processes may load the same dataset at once: one fetches or builds it, the others wait. A cache
    that cannot be written to serves what is in it.

    Args:
        dataset_id: such as `coop_nav-medium` (the newest version) or `coop_nav-medium-v1`; an
            address such as `hf://org/coop_nav-medium@v1` or `s3://bucket/coop_nav-medium-v1`; or
            the folder of a dataset. A list of them is a mixture: their specs have to be equal.
        weights: of a mixture: in proportion to which rows of batches come from each dataset; None:
            its number of steps, so that all transitions are equally likely.
        stream: whether datasets are opened without being fetched or built: their chunks are fetched
            when they are read. A `Stream` also says how much is kept in memory, of each dataset,
            and on the disk.
        observation: the observation model to compute observations with, such as `lidar`; see
            `Dataset.reobserve`. None: the recorded one.
        communication: the communication model, such as `lossy-30`, in the same way.
        rewards: weights to compute rewards with, such as `{"robot_collision": 2.0}`, or the
            name of a set in `specs.rules`: `"safe"`, or `"team"`, which gives every
            robot the mean reward of the team; or a function of the recorded episodes that can be
            imported, as "module:name"; see `Dataset.with_rewards`. None: the recorded rewards.
        side: the side whose agents are wanted alone, such as `pursuers`; see `Dataset.side`.
        path: the folder of the dataset of a shipped recipe, where it is not in the cache.
        verify: how much is checked before arrays are handed out; see `Dataset.open`.
        offline: whether no remote is asked; where SWARMDATA_OFFLINE or HF_HUB_OFFLINE is set, none
            is, even with False. Datasets with a recipe are still built.
        workers: processes that build; by default one for each core.
        progress: whether to show a bar while fetching or building.

    Raises:
        UnknownNameError: no such dataset, model, reward weight or side; the message has the nearest
            name.
        AddressError: a malformed address.
        SpecError: a malformed model, learned messages that were not recorded, wrong weights of a
            mixture.
        SchemaError: the dataset has no terms of rewards, which `rewards` needs; the specs of a
            mixture differ; or an id is an object of another type.
        BuildError: it could not be built.
        HubError: the dataset at an address could not be fetched.
        DatasetError: the files cannot be used.
    """
    names = list_of("dataset_id", dataset_id, "the id or folder of a dataset", OPEN_AGAIN)
    _check_number(dataset_id, weights, path)
    shared: dict[str, Any] = {
        "observation": observation, "communication": communication, "progress": progress,
    }  # fmt: skip
    if stream:
        _refuse_streamed(verify, rewards=rewards, side=side, path=path, workers=workers)
        from swarmdata.hub.catalog.streams import open_streamed  # noqa: PLC0415  (all of streaming)

        wanted = None if stream is True else stream
        open_one: Callable[[str | Path], Dataset | StreamedDataset] = partial(
            open_streamed, stream=wanted, is_offline=is_offline(offline), **shared
        )
    else:
        own: dict[str, Any] = {
            "path": path, "rewards": rewards, "side": side, "verify": verify, "workers": workers,
        }  # fmt: skip
        open_one = partial(_open, offline=offline, **own, **shared)
    if isinstance(dataset_id, str | Path):
        return open_one(dataset_id)
    from swarmdata.datasets.mixture import mix  # noqa: PLC0415  (most calls mix nothing)

    return mix([open_one(each) for each in names], weights)


def _check_number(dataset_id: object, weights: Sequence[float] | None, path: object) -> None:
    """Refuses what is of several datasets for one, and the other way round."""
    is_one = isinstance(dataset_id, str | Path)
    if is_one and weights is not None:
        raise SpecError(
            f"weights are {list(weights)} with the one dataset {str(dataset_id)!r}, expected a "
            "list of datasets to mix with them"
        )
    if path is not None and not is_one:
        raise SpecError("path is of one dataset, got it with a list of datasets; leave it out")


def _open(
    dataset_id: str | Path,
    path: Path | str | None,
    *,
    observation: Source | None,
    communication: Source | None,
    rewards: "RewardChoice | None",
    side: str | None,
    verify: Verify,
    offline: bool | None,
    workers: int | None,
    progress: bool,
) -> Dataset:
    request = parse_request(dataset_id, path)
    _check_view(request, observation, communication, rewards, side)
    found = cached(request)
    if found is None:  # what fetches and builds is imported only then
        from swarmdata.hub.catalog.sources import Rebuild, Remotes, obtain  # noqa: PLC0415

        remotes = Remotes(offline=is_offline(offline), progress=progress)
        found = obtain(request, remotes, Rebuild(remotes, workers, progress))
    stored = open_store(found.folder, verify, made_from=request.made_from)
    whole, arrays = np.arange(stored.manifest.n_episodes), stored.arrays
    references = references_for(stored.recipe, arrays, arrays.__getitem__)
    dataset = Dataset(stored, whole, references, found.source)
    identity = judge(stored.manifest)
    if identity.kind != "published":
        check_spec(stored.path, stored.manifest, stored.recipe, widths=True)
    if not identity.is_as_named:
        kind = RebuiltDifferentlyWarning if identity.kind == "rebuilt" else AnotherDatasetWarning
        warnings.warn(f"{stored.path}: {identity.sentence}.", kind, stacklevel=3)
    if (sentence := misnamed(stored.path, stored.manifest)) is not None:
        warnings.warn(f"{sentence}.", AnotherDatasetWarning, stacklevel=3)
    if isinstance(rewards, str) and ":" in rewards:
        dataset = dataset.with_rewards(import_function(rewards))
    elif rewards:
        dataset = dataset.with_rewards(**chosen_weights(rewards, dataset.task.rules))
    dataset = dataset.reobserve(observation, communication, progress=progress)
    return dataset if side is None else dataset.side(side)


def _check_view(
    request: Request,
    observation: Source | None,
    communication: Source | None,
    rewards: "RewardChoice | None",
    side: str | None,
) -> None:
    """Refuses what a dataset of a recipe cannot be seen as, before it is built in minutes."""
    if isinstance(rewards, str) and ":" in rewards:
        import_function(rewards)
        rewards = None
    has_models = observation is not None or communication is not None
    is_plain = not (has_models or rewards or side)
    recipe = None if is_plain else request.recipe  # that takes time to make
    if recipe is None:
        return
    spec = recipe.spec
    if has_models:
        check_messages(with_models(spec, observation, communication), spec)
    if rewards:
        changed_weights(spec.rules.rewards, chosen_weights(rewards, spec.rules))
    if side is not None:
        spec.side(side)


def _refuse_streamed(verify: Verify, **options: object) -> None:
    """Refuses what streams do not have; None is left out."""
    given = [name for name, value in options.items() if value is not None]
    given += [] if verify == "fast" else ["verify"]
    if given:
        raise SpecError(
            f"stream does not go with {', '.join(given)}, expected datasets as they are recorded"
        )


def find_folder(name: str | Path) -> Path:
    """Where a dataset is or would be: a folder itself, or the place of an id in the cache.

    Raises:
        UnknownNameError: neither a folder, nor the id of a recipe or of what is in the cache.
        AddressError: the name is empty, or a malformed address.
    """
    request = parse_request(name)
    if request.folder is not None and (request.made_from or request.source == "folder"):
        return request.folder
    found = cached(request)
    if found is None:
        from swarmdata.hub.catalog.sources import Remotes, unknown_dataset  # noqa: PLC0415

        remotes = Remotes(offline=True)
        found = cached(remotes.pin(request))
        if found is None:
            raise unknown_dataset(request, remotes)
    return found.folder


def references_for(
    origin: Origin, names: Container[str], rows: Callable[[str], Any]
) -> Reference | None:
    """The anchors of a dataset's score; none if its rewards are not those of its task.

    `names` are those of its arrays; `rows` gives one from its first joint step on.
    """
    world = origin.spec.world
    measured = None if world is None else references_of(world.hash())
    known = None if measured is None else measured.reference
    if known is None or origin.recipe is not None:
        return known
    from swarmdata.datasets.task_rewards import are_of_task  # noqa: PLC0415  (rarely needed)

    return known if are_of_task(origin, names, rows) else None
