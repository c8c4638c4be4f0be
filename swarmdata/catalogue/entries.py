"""Entries of the catalogue: what is shown of each dataset, of its files or as published."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.task_rewards import has_task_rewards
from swarmdata.errors import MissingFileError, SpecError
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.listing import list_datasets
from swarmdata.registry.published import (
    Interval,
    normalized_score,
    published,
    references_of,
    side_references,
)
from swarmdata.registry.recipes import find_recipe
from swarmdata.registry.tiers import outlines
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.origins import Origin, Spec
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.publication import figures_of

Kind = Literal["simulated", "robot logs", "other environment"]
"""Worlds of this package, logs of robots, and what was recorded in other environments."""

_COLLISIONS = tuple(
    re.compile(rf"^\| {who} collisions per episode \| ([\d.]+) \|$", re.MULTILINE)
    for who in ("robot", "obstacle")
)
"""Rows of a published card."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One dataset of the catalogue; figures that are not known are None."""

    id: str  # also the name of its page and of its data folder
    origin: Origin  # what it was made from
    n_steps: int
    n_episodes: int | None
    n_bytes: int | None
    success: float | None
    clean_success: float | None
    score: float | None
    collisions: tuple[float, float] | None  # with robots and with obstacles, per episode
    digest: str | None
    card: str | None  # Markdown
    dataset: Dataset | None  # None: its episodes are not shown

    @property
    def spec(self) -> Spec:
        """What the episodes are of."""
        return self.origin.spec

    @property
    def kind(self) -> Kind:
        """Where the episodes are from."""
        if self.origin.kind == "logs":
            return "robot logs"
        is_ours = self.spec.world is not None and self.origin.kind != "recording"
        return "simulated" if is_ours else "other environment"

    @property
    def is_mini(self) -> bool:
        """Whether it is a mini of the package; what users call so is a dataset of its own."""
        return _is_mini(self.id) and self.id in outlines()

    @property
    def full_id(self) -> str:
        """The id of the dataset that it is a mini of; its own if it is none."""
        return self.id.replace("-mini-", "-") if self.is_mini else self.id

    @property
    def gaps(self) -> Mapping[str, Mapping[str, Interval]]:
        """The coordination gaps of its task by less coordinated team; none if not measured.

        In a task of several sides, those of the first.
        """
        known = references_of(self.spec.hash())
        if known is None and self.spec.world is not None:
            known = next(iter(side_references(self.spec.world).values()), None)
        return {} if known is None else known.gaps

    @property
    def solved(self) -> str:
        """What an episode with success is called: of several sides, the first wins it."""
        sides = () if self.spec.world is None else self.spec.world.sides
        return f"won by {sides[0].name}" if len(sides) > 1 else "solved"

    @property
    def need(self) -> float | None:
        """Points of clean success that robots lose who ignore each other; None: not measured."""
        alone = self.gaps.get("scripted-alone")
        return None if alone is None else 100 * alone["clean_success"].value

    @property
    def reward_spec(self) -> TaskSpec | None:
        """The task whose terms and weights make the rewards; None if others do."""
        is_own = self.dataset is None or has_task_rewards(self.dataset.stored)
        return self.spec.world if is_own else None

    @property
    def has_messages(self) -> bool:
        """Whether robots send messages."""
        return self.spec.world is not None and self.spec.world.communication.kind != "none"


def in_sizes(entries: Sequence[Entry]) -> list[list[Entry]]:
    """The entries, those of one dataset together: the full one before its mini."""
    found: dict[str, list[Entry]] = {}
    for entry in sorted(entries, key=lambda each: (each.full_id, each.is_mini)):
        found.setdefault(entry.full_id, []).append(entry)
    return list(found.values())


def find_entries(
    names: Sequence[str],
    failures: Failures,
    *,
    workers: int | None = None,
    with_published: bool = True,
) -> list[Entry]:
    """Returns the entries of a catalogue, in the order of their ids.

    `names` are ids, addresses or folders whose episodes are shown, without any those in the cache;
    `with_published` adds the other published datasets. What cannot be opened is in `failures`.
    """
    found: dict[str, Entry] = {}
    cached = (cache_folder() / "datasets").glob("*/manifest.json")
    for name in names or [str(file.parent) for file in sorted(cached)]:
        with failures.item(name):
            dataset = load(name, workers=workers)
            earlier = found.get(dataset.id)
            if earlier is not None and earlier.digest != dataset.digest:
                raise SpecError(
                    f"two datasets are called {dataset.id}, with digests "
                    f"{str(earlier.digest)[:12]} and {dataset.digest[:12]}. Show one of them, or "
                    "rename the other."
                )
            found[dataset.id] = _of_dataset(dataset)
    for info in list_datasets() if with_published else ():
        if info.id not in found:
            found[info.id] = _of_published(info.id, info.n_steps, info.score)
    return [found[key] for key in sorted(found)]


def _is_mini(dataset_id: str) -> bool:
    return without_version(dataset_id).endswith("-mini")


def published_minis() -> list[str]:
    """Ids of all published datasets that are minis."""
    return [info.id for info in list_datasets() if _is_mini(info.id)]


def _of_dataset(dataset: Dataset) -> Entry:
    manifest, table, references = dataset.stored.manifest, dataset.episodes, dataset.references
    figures, is_world = figures_of(table), dataset.recipe.spec.world is not None
    score, collisions = None, None
    if references is not None:
        score = float(normalized_score(figures.mean_return, references))
    if is_world:
        counts = table.robot_collisions, table.obstacle_collisions
        collisions = float(counts[0].mean()), float(counts[1].mean())
    try:
        card = dataset.card
    except MissingFileError:
        card = None  # the page says that there is none
    tells_success = is_world or figures.success > 0
    return Entry(
        id=dataset.id,
        origin=dataset.recipe,
        n_steps=manifest.n_steps,
        n_episodes=manifest.n_episodes,
        n_bytes=sum(file.size for file in manifest.files.values()),
        success=figures.success if tells_success else None,
        clean_success=figures.clean_success if is_world else None,
        score=score,
        collisions=collisions,
        digest=dataset.digest,
        card=card,
        dataset=dataset,
    )


def _of_published(dataset_id: str, n_steps: int, score: float | None) -> Entry:
    recipe, figures = find_recipe(dataset_id), published().get(dataset_id)
    file = files("swarmdata.cards").joinpath("published", f"{dataset_id}.md")
    card = file.read_text(encoding="utf-8") if file.is_file() else None
    return Entry(
        id=dataset_id,
        origin=recipe,
        n_steps=n_steps,
        n_episodes=figures.n_episodes if figures else None,
        n_bytes=figures.n_bytes if figures else None,
        success=figures.success if figures else None,
        clean_success=figures.clean_success if figures else None,
        score=score,
        collisions=None if card is None else collisions_on(card),
        digest=figures.digest if figures else None,
        card=card,
        dataset=None,
    )


def collisions_on(card: str) -> tuple[float, float] | None:
    """The mean collisions of an episode, with robots and with obstacles, that a card states."""
    robots, obstacles = (pattern.search(card) for pattern in _COLLISIONS)
    return None if robots is None or obstacles is None else (float(robots[1]), float(obstacles[1]))
