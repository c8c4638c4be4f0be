"""The data files of a dataset: a table of its episodes, and chunks with what is replayed.

Each file is a script that calls a function of `assets/data.js`. Episodes are in chunks of about a
hundred kilobytes, so that a page loads at once and a replay in a moment.
"""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.catalogue.replays.packing import pack
from swarmdata.catalogue.replays.series_columns import IMAGE_EPISODES, SeriesColumns
from swarmdata.catalogue.replays.world_columns import Columns, Group, WorldColumns
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import reobserved_episode
from swarmdata.errors import SchemaError
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.table import SPLITS
from swarmdata.types import END_REASONS, Episode, Int

CHUNK_VALUES = 100_000
"""Numbers in a chunk, at least those of one episode."""


@dataclass
class _Chunk:
    """Episodes that go into one file."""

    episodes: list[int] = field(default_factory=list)  # positions in the table
    blocks: list[Columns] = field(default_factory=list)
    n_values: int = 0


def write_data(dataset: Dataset, spec: Spec, shown: Int, folder: Path) -> None:
    """Writes the data files of a dataset into a new folder.

    Args:
        dataset: to show.
        spec: its own, or with other models, through which the episodes are observed again.
        shown: positions of the episodes, in order.
        folder: to make; its name is the dataset's key in the scripts.
    """
    folder.mkdir(parents=True)
    if spec.world is not None:
        described = replay_table(_seen(dataset, spec.world, shown), spec.world, folder)
    else:
        described = _recorded(dataset, spec, shown, folder)
    write_script(
        folder, "episodes.js", "episodes", {**described, "episodes": _table(dataset, shown)}
    )


def _seen(dataset: Dataset, spec: TaskSpec, shown: Int) -> Iterator[Episode]:
    """The episodes as they are observed through the models of a spec."""
    for index in shown.tolist():
        episode = dataset[index]
        yield episode if spec == dataset.task else reobserved_episode(episode, dataset.task, spec)


def replay_table(episodes: Iterable[Episode], spec: TaskSpec, folder: Path) -> dict[str, Any]:
    """Writes the chunks of episodes of a world, and returns what the browser replays them by."""
    columns = WorldColumns(spec)
    groups: dict[str, list[Group]] = {}

    def blocks() -> Iterator[list[Columns]]:
        for episode in episodes:
            found = {"moving": columns.moving(episode), "fixed": columns.fixed(episode)}
            _check_layout(groups, found, folder.name)
            yield [np.concatenate([part for _, part in each], axis=1) for each in found.values()]

    starts = _write_chunks(_chunks(blocks()), folder)
    described = {name: [group.to_json() for group in each] for name, each in groups.items()}
    return {"world": columns.describe(), **described, "chunks": starts}


def _write_chunks(chunks: Sequence[_Chunk], folder: Path) -> list[int]:
    """Writes a script for each chunk; returns the positions at which they start."""
    for number, chunk in enumerate(chunks):
        write_script(folder, f"{number}.js", "chunk", number, pack(chunk.blocks))
    return [chunk.episodes[0] for chunk in chunks]


def _check_layout(
    groups: dict[str, list[Group]],
    found: dict[str, list[tuple[Group, Columns]]],
    dataset: str,
) -> None:
    """Notes the columns of the first episode, and refuses others."""
    here = {name: [group for group, _ in each] for name, each in found.items()}
    if groups and here != groups:
        raise SchemaError(f"the episodes of {dataset} have different columns: {here}, {groups}")
    groups.update(here)


def _recorded(dataset: Dataset, spec: Spec, shown: Int, folder: Path) -> dict[str, Any]:
    episodes = [dataset[index] for index in shown.tolist()]
    columns = SeriesColumns(spec, episodes)
    starts = _write_chunks(_chunks([columns.moving(episode)] for episode in episodes), folder)
    described: dict[str, Any] = {"series": columns.describe(), "chunks": starts}
    if columns.image_shape:
        described["images"] = _write_images(columns, episodes[:IMAGE_EPISODES], folder)
    return described


def _write_images(columns: SeriesColumns, episodes: Sequence[Episode], folder: Path) -> list[Any]:
    """Writes a file with the images of each episode; returns the states that they show."""
    frames = []
    for position, episode in enumerate(episodes):
        states, pixels = columns.images(episode)
        frames.append(states.tolist())
        write_script(folder, f"images-{position}.js", "images", position, pack([pixels], order=1))
    return frames


def _chunks(episodes: Iterable[list[Columns]]) -> list[_Chunk]:
    """Gathers the blocks of episodes into chunks."""
    chunks = [_Chunk()]
    for position, blocks in enumerate(episodes):
        size = sum(block.size for block in blocks)
        if chunks[-1].episodes and chunks[-1].n_values + size > CHUNK_VALUES:
            chunks.append(_Chunk())
        chunks[-1].episodes.append(position)
        chunks[-1].blocks += blocks
        chunks[-1].n_values += size
    return chunks if chunks[-1].episodes else []


def _table(dataset: Dataset, shown: Int) -> dict[str, Any]:
    """Columns of the table of episodes, by name."""
    table = dataset.episodes.take(shown)
    return {
        "index": shown.tolist(),
        "length": table.lengths.tolist(),
        "return": [
            float(f"{value:.6g}") if math.isfinite(value) else None
            for value in table.team_return.tolist()
        ],
        "end": table.end_reason.tolist(),
        "policy": table.policy.tolist(),
        "split": table.split.tolist(),
        "robot_collisions": table.robot_collisions.tolist(),
        "obstacle_collisions": table.obstacle_collisions.tolist(),
        "seed": [str(seed) for seed in table.seeds.tolist()],
        "policies": [policy.label for policy in dataset.recipe.policies],
        "splits": list(SPLITS),
        "ends": list(END_REASONS),
    }


def write_script(folder: Path, name: str, function: str, *arguments: Any) -> None:
    """Writes a script that hands its arguments to a function of the catalogue."""
    words = [
        json.dumps(each, separators=(",", ":"), allow_nan=False)
        for each in (folder.name, *arguments)
    ]
    (folder / name).write_text(f"swarmdata.{function}({','.join(words)});\n", encoding="utf-8")
