"""The datasets there are, and how an id becomes an open dataset: cache, else rebuild.

A dataset is looked for in the cache; what is not there is built from the recipe in the package, so
that everything works without a network. (A remote belongs between these two steps of `load`.)
"""

import os
import warnings
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

from swarmdata.behavior_policies.tiers import find_recipe, shipped_recipes
from swarmdata.cards.schema import (
    Published,
    TaskReferences,
    changed_versions,
    published,
    references_of,
)
from swarmdata.dataset import Dataset
from swarmdata.metrics import Reference
from swarmdata.models import Source, with_models
from swarmdata.recipes import build, is_finished
from swarmdata.reobserve import check_messages
from swarmdata.spec import Recipe, TaskSpec
from swarmdata.store.reading import Verify


class RebuiltDifferentlyWarning(UserWarning):
    """A dataset rebuilt on this machine does not have the published digest."""


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


def cache_folder() -> Path:
    """Where datasets are kept: `SWARMDATA_CACHE`, else the user's cache folder."""
    named = os.environ.get("SWARMDATA_CACHE")
    return Path(named) if named else user_cache_path("swarmdata")


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
    dataset_id: str,
    *,
    observation: Source | None = None,
    communication: Source | None = None,
    path: Path | str | None = None,
    verify: Verify = "fast",
    workers: int | None = None,
    progress: bool = True,
) -> Dataset:
    """Opens a dataset, which is built first where it is not in the cache.

    Several processes may load the same dataset at once: one builds it, the others wait. A cache
    that cannot be written to serves what is in it.

    Args:
        dataset_id: such as `coop_nav-medium` (the newest version) or `coop_nav-medium-v0`.
        observation: what the robots shall have sensed, such as `lidar`; see `Dataset.reobserve`.
            None: what was recorded.
        communication: what they shall have heard, such as `lossy-30`; the same.
        path: the dataset's folder, if not the one in the cache.
        verify: how much is checked before arrays are handed out; see `Dataset.open`.
        workers: processes that build; by default one for each core.
        progress: whether to show a bar while building.

    Raises:
        UnknownNameError: no such dataset or model; the message has the nearest name.
        SpecError: a malformed model, or learned messages that were not recorded.
        BuildError: it could not be built.
        DatasetError: the files cannot be used.
    """
    recipe = find_recipe(dataset_id)
    seen = with_models(recipe.spec, observation, communication)
    check_messages(seen, recipe.spec)  # before building, which may take minutes
    folder = Path(path) if path is not None else dataset_folder(recipe)
    source = "cache" if path is None else "folder"
    if not is_finished(folder, recipe):
        build(recipe, folder, workers=workers, progress=progress)
        source = "rebuilt"
    dataset = Dataset.open(folder, verify, known_references(recipe.spec), source)
    entry = published().get(recipe.id)
    if entry is not None and entry.digest != dataset.digest:
        warnings.warn(_differs(dataset, entry), RebuiltDifferentlyWarning, stacklevel=2)
    return dataset.reobserve(seen.observation, seen.communication, progress=progress)


def known_references(spec: TaskSpec) -> Reference | None:
    """The anchors of the normalized score measured on exactly this spec, if there are any."""
    found: TaskReferences | None = references_of(spec.hash())
    if found is None or found.no_skill is None or found.expert is None:
        return None
    return Reference(no_skill=found.no_skill, expert=found.expert)


def _differs(dataset: Dataset, entry: Published) -> str:
    changed = changed_versions(entry.made_with, dataset.stored.manifest.provenance)
    return (
        f"{dataset.id} at {dataset.path} has digest {dataset.digest[:12]}, the published one has "
        f"{entry.digest[:12]}. It is kept and usable, but results on it are not exactly comparable."
        f" It was built with {', '.join(changed) or 'the same versions on other hardware'}."
    )
