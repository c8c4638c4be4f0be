"""Datasets of a study: whole, published minis, or first episodes as a dataset of their own.

The first episodes are written as an edited dataset, so that a run on them names their digest, and
normalization statistics come from them alone.
"""

import re
from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.tiers import find_recipe, is_dataset
from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.evaluation.study.plan import Size
from swarmdata.hub.catalog.catalog import load
from swarmdata.registry.published import Figures, published
from swarmdata.specs.frozen import Frozen
from swarmdata.store.cache import cache_folder
from swarmdata.store.publication import figures_of

FULL, MINI = "full", "mini"


class Facts(Frozen):
    """What a dataset's own episodes achieved: the row that every algorithm is compared with."""

    id: str
    digest: str
    figures: Figures  # of all episodes, action noise included
    robot_collisions: float
    obstacle_collisions: float

    @classmethod
    def of(cls, dataset: Dataset) -> "Facts":
        """Reads the table of episodes."""
        table = dataset.episodes
        return cls(
            id=dataset.id,
            digest=dataset.digest,
            robot_collisions=float(table.robot_collisions.mean()),
            obstacle_collisions=float(table.obstacle_collisions.mean()),
            figures=figures_of(table),
        )


def named(dataset: str) -> str:
    """Short name of a dataset: its id, or the name of its folder."""
    return dataset if is_dataset(dataset) else Path(dataset).resolve().name


def sized(dataset: str, size: Size) -> tuple[str, int | None]:
    """What to load for a size: a dataset, and how many of its first joint steps, None for all.

    Raises:
        SchemaError: a folder has no mini.
    """
    if size == FULL:
        return dataset, None
    if size != MINI:
        return dataset, int(size)
    if not is_dataset(dataset):
        raise SchemaError(f"{dataset} is a folder, which has no mini; give a number of joint steps")
    name, version = re.fullmatch(r"(.*?)(-v\d+)?", dataset).groups()  # type: ignore[union-attr]
    return f"{name}-mini{version or ''}", None


def short(n_steps: int) -> str:
    """200000 as 200k, for names."""
    return f"{n_steps // 1000}k" if n_steps % 1000 == 0 else str(n_steps)


def digest_of(dataset: str, *, progress: bool = True) -> str:
    """The digest of a dataset's arrays: the published one, else that of what `load` gives."""
    if is_dataset(dataset):
        entry = published().get(find_recipe(dataset).id)
        if entry is not None:
            return entry.digest
    return load(dataset, progress=progress).digest


def open_data(
    dataset: str,
    n_steps: int | None = None,
    *,
    observation: str | None = None,
    communication: str | None = None,
) -> Dataset:
    """Opens a dataset of a study, built where it is absent.

    Args:
        dataset: id or folder.
        n_steps: only its first episodes, of at least so many joint steps in all.
        observation: seen through another model than the recorded one.
        communication: the same.

    Raises:
        SchemaError: there are not so many steps.
    """
    found = load(dataset, progress=False)
    if n_steps is not None:
        found = _first(found, n_steps)
    return found.reobserve(observation, communication, progress=False)


def _first(dataset: Dataset, n_steps: int) -> Dataset:
    """The first episodes, as a dataset of their own in the cache, made if need be."""
    ends = np.cumsum(dataset.episodes.lengths)
    if ends[-1] < n_steps:
        raise SchemaError(
            f"{dataset.id} has {int(ends[-1]):,} joint steps, the study asks for its first "
            f"{n_steps:,}"
        )
    count = int(np.searchsorted(ends, n_steps)) + 1
    name, version = dataset.id.rsplit("-", 1)
    short_id = f"{name}-{short(n_steps)}-{version}"
    out = cache_folder() / "first" / f"{short_id}-{dataset.digest[:12]}"
    return filter_dataset(dataset, out, id=short_id, episodes=range(count))
