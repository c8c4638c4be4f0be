"""Datasets of a study: whole, published minis, mixtures, or first episodes as own datasets."""

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture, mix
from swarmdata.datasets.views import View
from swarmdata.errors import SchemaError, SpecError
from swarmdata.evaluation.runs.provenance import dataset_key
from swarmdata.evaluation.study.plan import Size
from swarmdata.hub.catalog.catalog import load
from swarmdata.registry.published import Figures, published
from swarmdata.registry.recipes import find_recipe, is_dataset
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import SideSpec, check_installed, task_of
from swarmdata.specs.recipe import Splits
from swarmdata.specs.rules import RewardChoice, changed_weights, chosen_weights
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.publication import figures_of


class DatasetFacts(Frozen):
    """What the episodes of a dataset, or a side in them, achieved: the row to compare with.

    Returns are of the recorded rewards, whatever rewards an algorithm learns from. Means of a
    mixture are those of its datasets, weighted as the mixture weighs them.
    """

    id: str  # `dataset_key` of a side or a mixture
    digest: str
    figures: Figures  # of all episodes, action noise included
    robot_collisions: float
    obstacle_collisions: float
    n_train_steps: int | None = None  # joint steps to learn from; None: recorded before it was kept

    @classmethod
    def of(cls, dataset: View[Any] | Mixture) -> "DatasetFacts":
        """Reads the table of episodes."""
        if isinstance(dataset, Mixture):
            return cls._of_mixture(dataset)
        table, side = dataset.episodes, isinstance(dataset.spec, SideSpec)
        figures = figures_of(table)
        if isinstance(dataset, Dataset) and side:
            figures = replace(figures, clean_success=_clean_success_of_side(dataset))
        return cls(
            id=str(dataset_key(dataset.id, dataset.view if side else None)),
            digest=dataset.digest,
            robot_collisions=float(table.robot_collisions.mean()),
            obstacle_collisions=float(table.obstacle_collisions.mean()),
            figures=figures,
            n_train_steps=int(dataset.filter(split="train").episodes.lengths.sum()),
        )

    @classmethod
    def _of_mixture(cls, mixture: Mixture) -> "DatasetFacts":
        parts = [cls.of(part) for part in mixture.parts]

        def mean(values: Iterable[float]) -> float:
            return float(np.dot(mixture.weights, list(values)))

        return cls(
            id=str(dataset_key(mixture.id, mixture.view)),
            digest=mixture.digest,
            robot_collisions=mean(each.robot_collisions for each in parts),
            obstacle_collisions=mean(each.obstacle_collisions for each in parts),
            figures=Figures(
                n_steps=mixture.n_steps,
                n_episodes=len(mixture),
                mean_return=mean(each.figures.mean_return for each in parts),
                success=mean(each.figures.success for each in parts),
                clean_success=mean(each.figures.clean_success for each in parts),
            ),
            n_train_steps=mixture.split("train").n_steps,
        )

    @property
    def train_steps(self) -> int:
        """Joint steps to learn from; by the default shares of the splits where it is not known."""
        if self.n_train_steps is not None:
            return self.n_train_steps
        rule = Splits()
        share = 1.0 - (rule.validation + rule.test) / rule.block
        return round(share * self.figures.n_steps)


def _clean_success_of_side(dataset: Dataset) -> float:
    """The share of episodes that a side solves without touching anything, as it is evaluated."""
    table, events = dataset.episodes, dataset.stored.arrays["events"]
    episodes = zip(table.starts.tolist(), (table.starts + table.lengths).tolist(), strict=True)
    touched = np.array([events[first:end].any() for first, end in episodes])
    return float((table.success & ~touched).mean())


def short_name(dataset: str) -> str:
    """Returns the id of a dataset, or the name of its folder."""
    return dataset if is_dataset(dataset) else Path(dataset).resolve().name


def dataset_of_size(dataset: str, size: Size) -> tuple[str, int | None]:
    """Which dataset to load for a size, and how many of its first joint steps; None: all."""
    if size != "mini":
        return dataset, None if size == "full" else size
    if not is_dataset(dataset):
        raise SchemaError(
            f"{dataset} is a folder, which has no mini. Give a number of joint steps instead."
        )
    name, version = re.fullmatch(r"(.*?)(-v\d+)?", dataset).groups()  # type: ignore[union-attr]
    return f"{name}-mini{version or ''}", None


def short_count(n_steps: int) -> str:
    """Writes 200000 as 200k, for names."""
    return f"{n_steps // 1000}k" if n_steps % 1000 == 0 else str(n_steps)


def digest_of(dataset: str, *, progress: bool = True) -> str:
    """Returns the digest of a dataset's arrays: published, else of the loaded dataset."""
    if is_dataset(dataset):
        entry = published().get(find_recipe(dataset).id)
        if entry is not None:
            return entry.digest
    return load(dataset, progress=progress).digest


def joint_digest(digests: Iterable[str], weights: Collection[float]) -> str:
    """Returns the SHA-256 of the digests of a mixture's datasets and of their shares."""
    shares = [[digest, w / sum(weights)] for digest, w in zip(digests, weights, strict=True)]
    return hashlib.sha256(json.dumps(shares).encode()).hexdigest()


def changed_rewards(dataset: str, choice: RewardChoice) -> dict[str, float]:
    """Returns the weights in which chosen rewards differ from those of a dataset, by name.

    Raises:
        UnknownNameError: no such weight or set.
    """
    rules = recorded_task(dataset, "learning from other rewards").rules
    changed = changed_weights(rules.rewards, chosen_weights(choice, rules))
    found = {name: value for name, value in changed if value != getattr(rules.rewards, name)}
    if not found:
        raise SpecError(
            f"rewards {choice!r} leave the weights of {dataset} as they are, expected others; "
            "leave them out to learn from the recorded rewards."
        )
    return found


def task_name(dataset: str) -> str:
    """Returns the name of the task of a dataset, whose code may be a user's."""
    found = find_recipe(dataset) if is_dataset(dataset) else load(dataset, progress=False)
    return found.spec.task


def recorded_task(dataset: str, what: str) -> TaskSpec:
    """Returns the task of a dataset, for `what`; raises SpecError where it has no simulator."""
    recipe = find_recipe(dataset) if is_dataset(dataset) else load(dataset).recipe
    return task_of(recipe, what)


def open_dataset(
    dataset: str,
    n_steps: int | None = None,
    *,
    observation: str | None = None,
    communication: str | None = None,
) -> Dataset:
    """Loads a dataset of a study; it is built if it is not in the cache.

    With `n_steps`, only the first episodes are kept, with at least so many joint steps in total.
    Without models, it is observed as recorded.

    Raises:
        SchemaError: the dataset has fewer steps.
        SpecError: another package defines its task, and is not installed.
    """
    found = load(dataset, progress=False)
    check_installed(found.recipe, "a study")
    if n_steps is not None:
        found = _first_episodes(found, n_steps)
    return found.reobserve(observation, communication, progress=False)


def open_mixture(
    parts: Mapping[str, float], *, observation: str | None, communication: str | None
) -> Mixture:
    """Loads the datasets of a mixture, weights by id or folder, as `open_dataset` does."""
    opened = [
        open_dataset(part, observation=observation, communication=communication) for part in parts
    ]
    return mix(opened, list(parts.values()))


def _first_episodes(dataset: Dataset, n_steps: int) -> Dataset:
    """The first episodes as a separate dataset in the cache, which is made on first use."""
    ends = np.cumsum(dataset.episodes.lengths)
    if ends[-1] < n_steps:
        raise SchemaError(
            f"{dataset.id} has {int(ends[-1]):,} joint steps, but the study asks for its first "
            f"{n_steps:,}"
        )
    count = int(np.searchsorted(ends, n_steps)) + 1
    name, version = dataset.id.rsplit("-", 1)
    short_id = f"{name}-{short_count(n_steps)}-{version}"
    out = cache_folder() / "first" / f"{short_id}-{dataset.digest[:12]}"
    return filter_dataset(dataset, out, id=short_id, episodes=range(count))
