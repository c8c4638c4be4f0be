"""The datasets there are, and how an id becomes an open dataset: cache, remotes, rebuild.

A dataset is looked for in the cache, then on the configured remotes; what is nowhere is built from
the recipe in the package, so that everything works without a network.
"""

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

from swarmdata.behavior_policies.tiers import find_recipe, shipped_recipes
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import check_messages
from swarmdata.errors import AddressError, DatasetNotFoundError, SpecError, UnknownNameError
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.sources import (
    OFFLINE,
    Found,
    is_offline,
    obtain,
    obtain_address,
    obtain_foreign,
)
from swarmdata.hub.remotes.addresses import configured_remotes, is_address
from swarmdata.hub.remotes.outside_names import is_folder
from swarmdata.registry.published import (
    Published,
    Reference,
    TaskReferences,
    published,
    references_of,
)
from swarmdata.specs.model_choice import Source, with_models
from swarmdata.specs.origins import Spec
from swarmdata.specs.recipe import Recipe
from swarmdata.store.cache import cache_folder
from swarmdata.store.reading import Verify, check_widths


class RebuiltDifferentlyWarning(UserWarning):
    """A dataset that was built on this machine does not have the published digest."""


class AnotherDatasetWarning(UserWarning):
    """A dataset has the id of a published one, and is another."""


@dataclass(frozen=True)
class DatasetInfo:
    """One line of the catalog; what is not known before a first build is None."""

    id: str
    task: str
    tier: str
    n_agents: int
    n_steps: int
    n_episodes: int | None
    n_bytes: int | None
    score: float | None  # of the mean return of its episodes; 0 no skill, 100 expert
    digest: str | None
    is_cached: bool


def dataset_folder(recipe: Recipe) -> Path:
    """Where the cache keeps the dataset of a recipe, whether it is there or not."""
    return cache_folder() / "datasets" / recipe.id


def list_datasets() -> list[DatasetInfo]:
    """Returns every dataset of this version of the package, in the order of their ids."""
    return [_info(recipe) for _, recipe in sorted(shipped_recipes().items())]


def _info(recipe: Recipe) -> DatasetInfo:
    entry: Published | None = published().get(recipe.id)
    anchors = references_of(recipe.spec.hash())
    return DatasetInfo(
        id=recipe.id,
        task=recipe.spec.task,
        tier=recipe.tier,
        n_agents=recipe.spec.n_agents,
        n_steps=entry.n_steps if entry else recipe.n_steps,
        n_episodes=entry.n_episodes if entry else None,
        n_bytes=entry.n_bytes if entry else None,
        score=anchors.score(entry.mean_return) if entry and anchors else None,
        digest=entry.digest if entry else None,
        is_cached=(dataset_folder(recipe) / "manifest.json").exists(),
    )


def load(
    dataset_id: str | Path,
    *,
    observation: Source | None = None,
    communication: Source | None = None,
    path: Path | str | None = None,
    verify: Verify = "fast",
    offline: bool | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> Dataset:
    """Opens a dataset: from the cache, else from a remote, else built from its recipe.

    The remotes that are configured are asked in order (`swarmdata remote list`); one that fails, or
    has another dataset than the published one, is skipped with a warning. `source` of the result
    says what happened: `cache`, `folder`, `rebuilt`, or the address it was fetched from. Several
    processes may load the same dataset at once: one fetches or builds it, the others wait. A cache
    that cannot be written to serves what is in it.

    Args:
        dataset_id: such as `coop_nav-medium` (the newest version) or `coop_nav-medium-v0`; an
            address such as `hf://org/coop_nav-medium@v0` or `s3://bucket/coop_nav-medium-v0`; or
            the folder of a dataset.
        observation: what the robots shall have sensed, such as `lidar`; see `Dataset.reobserve`.
            None: what was recorded.
        communication: what they shall have heard, such as `lossy-30`; the same.
        path: where the dataset of a shipped recipe is or shall be, if not in the cache.
        verify: how much is checked before arrays are handed out; see `Dataset.open`.
        offline: whether no remote is asked; None: whether SWARMDATA_OFFLINE or HF_HUB_OFFLINE is
            set. What can be built is built all the same.
        workers: processes that build; by default one for each core.
        progress: whether to show a bar while fetching or building.

    Raises:
        UnknownNameError: no such dataset or model; the message has the nearest name.
        AddressError: a malformed address.
        SpecError: a malformed model, or learned messages that were not recorded.
        BuildError: it could not be built.
        HubError: the dataset at an address could not be had.
        DatasetError: the files cannot be used.
    """
    text = _checked(dataset_id)
    if path is not None:
        _checked(path)
    recipe = _recipe(dataset_id)
    if recipe is not None:
        seen = with_models(recipe.spec, observation, communication)
        check_messages(seen, recipe.spec)  # before building, which may take minutes
        found = _obtain(recipe, path, offline, workers, progress)
    elif path is not None:
        raise SpecError(
            f"path is where the dataset of a shipped id is or shall be, got it with {text!r}. "
            "Leave it out."
        )
    else:
        found = _elsewhere(dataset_id, is_offline(offline), progress)
    dataset = Dataset.open(found.folder, verify, None, found.source)
    dataset = replace(dataset, references=known_references(dataset.recipe.spec))
    identity = judge(dataset.stored.manifest)
    if identity.kind != "published":
        check_widths(dataset.stored)
    if not identity.is_as_named:
        kind = RebuiltDifferentlyWarning if identity.kind == "rebuilt" else AnotherDatasetWarning
        warnings.warn(f"{dataset.path}: {identity.sentence}.", kind, stacklevel=2)
    return dataset.reobserve(observation, communication, progress=progress)


def _checked(name: str | Path) -> str:
    """The name as text.

    Raises:
        AddressError: it is empty; as a path that would be the current folder.
    """
    if not str(name).strip():
        raise AddressError(
            f"the name of a dataset is {str(name)!r}, expected an id such as 'coop_nav-medium', an "
            "address or a folder; the current folder is '.'."
        )
    return str(name)


def _recipe(name: str | Path) -> Recipe | None:
    """The shipped recipe of an id; None: it is none. No folder of the same name comes before."""
    try:
        return find_recipe(name) if isinstance(name, str) else None
    except UnknownNameError:
        return None


def _obtain(
    recipe: Recipe,
    path: Path | str | None,
    offline: bool | None,
    workers: int | None,
    progress: bool,
) -> Found:
    """A shipped dataset; in a folder of the user's own its source is `folder`."""
    found = obtain(
        recipe,
        dataset_folder(recipe) if path is None else Path(path),
        remotes=() if is_offline(offline) else configured_remotes(),
        workers=workers,
        progress=progress,
    )
    is_there = path is not None and found.source == "cache"
    return Found(found.folder, "folder") if is_there else found


def _elsewhere(name: str | Path, offline: bool, progress: bool) -> Found:
    """What no shipped recipe makes: an address, a folder, or an id of a remote."""
    if isinstance(name, str) and is_address(name):
        return obtain_address(name, cache_folder() / "remotes", offline=offline, progress=progress)
    if is_folder(name):
        return Found(Path(name), "folder")
    if isinstance(name, Path):
        raise DatasetNotFoundError(f"there is no dataset folder at {name}")
    remotes = () if offline else configured_remotes()
    found = obtain_foreign(name, cache_folder() / "datasets", remotes=remotes, progress=progress)
    if found is None:
        raise UnknownNameError("dataset", name, _known(), hint=_where_to_look(name, offline))
    return found


def _known() -> list[str]:
    """Names that a mistyped one may mean."""
    return [key.rpartition("-v")[0] for key in shipped_recipes()]


def _where_to_look(name: str, offline: bool) -> str:
    """Which command gets a dataset that is nowhere, if somebody else has it."""
    command = f"swarmdata pull {name} --from hf://ORGANIZATION"
    if offline:
        return (
            "It is not in the cache, and no remote was asked. If it is on one, run with a network, "
            f"and without {' and '.join(OFFLINE)}: {command}"
        )
    asked = ", ".join(configured_remotes()) or "none is configured"
    return f"Remotes asked: {asked}. If it is on another one, run: {command}"


def find_folder(name: str | Path) -> Path:
    """Where a dataset is or would be: a folder itself, or the place of an id in the cache.

    Raises:
        UnknownNameError: neither a folder, nor the id of a recipe or of what is in the cache.
        AddressError: the name is empty, or a malformed address.
    """
    _checked(name)
    recipe = _recipe(name)
    if recipe is not None:
        return dataset_folder(recipe)
    return _elsewhere(name, offline=True, progress=False).folder


def known_references(spec: Spec) -> Reference | None:
    """The anchors of the normalized score measured on exactly this spec, if there are any."""
    found: TaskReferences | None = references_of(spec.hash())
    return None if found is None else found.reference
