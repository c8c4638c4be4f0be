"""The data files of a dataset: a sample of its episodes in a table, and chunks to replay them.

Each file is a script that calls a function of `assets/data.js`.
"""

import base64
import gzip
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.catalogue.replays.series_columns import IMAGE_EPISODES, SeriesColumns
from swarmdata.catalogue.replays.world_columns import Columns, Group, WorldColumns
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import reobserved_episode
from swarmdata.errors import SchemaError
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.table import SPLITS, EpisodeTable
from swarmdata.types import END_REASONS, Episode, Int

CHUNK_VALUES = 100_000  # numbers in a chunk, at least those of one episode


def choose_episodes(table: EpisodeTable, most: int | None) -> Int:
    """Returns the episodes to show, at most `most` unless it is None, in stored order.

    Each policy and end reason has its share of the sample, by largest remainders, and at least one
    episode while there is room. Within them, episodes are evenly spaced in stored order.
    """
    if most is None or len(table) <= most:
        return np.arange(len(table))
    kinds = table.policy.astype(np.int64) * 256 + table.end_reason
    _, kind, counts = np.unique(kinds, return_inverse=True, return_counts=True)
    chosen = []
    for k, n in enumerate(_shares(counts, most).tolist()):
        rows = np.flatnonzero(kind == k)
        chosen.append(rows[np.arange(n) * len(rows) // max(n, 1)])
    return np.sort(np.concatenate(chosen))


def _shares(counts: Int, most: int) -> Int:
    """Splits `most` over groups in proportion to their sizes, with at least one for each."""
    exact = most * counts / counts.sum()
    shares = np.maximum(np.floor(exact).astype(np.int64), 1)
    while shares.sum() < most:
        shares[np.argmax(exact - shares)] += 1
    while shares.sum() > most:  # of many small groups: the most over-represented first
        shares[np.argmax(np.where(shares > 0, shares - exact, -np.inf))] -= 1
    return shares


def write_data(dataset: Dataset, spec: Spec, shown: Int, folder: Path) -> None:
    """Writes the data files of a dataset into a new folder, named as its key in the scripts.

    Shows the episodes at some positions, in order, observed through the spec's models.
    """
    folder.mkdir(parents=True)
    episodes, world = (dataset[index] for index in shown.tolist()), spec.world
    if world is None:
        described = _recorded(spec, list(episodes), folder)
    elif world == dataset.task:
        described = replay_table(episodes, world, folder)
    else:
        seen = (reobserved_episode(each, dataset.task, world) for each in episodes)
        described = replay_table(seen, world, folder)
    described["episodes"] = _table(dataset, shown)
    write_script(folder, "episodes.js", "episodes", described)


def replay_table(episodes: Iterable[Episode], spec: TaskSpec, folder: Path) -> dict[str, Any]:
    """Writes the chunks of episodes of a world, and returns what the browser replays them by."""
    columns = WorldColumns(spec)
    groups: dict[str, list[Group]] = {}

    def blocks() -> Iterator[list[Columns]]:
        for episode in episodes:
            found = {"moving": columns.moving(episode), "fixed": columns.fixed(episode)}
            here = {name: [group for group, _ in each] for name, each in found.items()}
            if groups and here != groups:
                raise SchemaError(
                    f"the episodes of {folder.name} have different columns: {here}, {groups}"
                )
            groups.update(here)
            yield [np.concatenate([part for _, part in each], axis=1) for each in found.values()]

    starts = _write_chunks(blocks(), folder)
    return {"world": columns.describe(), **groups, "chunks": starts}


def _write_chunks(episodes: Iterable[list[Columns]], folder: Path) -> list[int]:
    """Gathers the blocks of episodes into scripts; returns the positions at which they start."""
    starts: list[int] = []
    gathered: list[Columns] = []

    def write() -> None:
        write_script(folder, f"{len(starts) - 1}.js", "chunk", len(starts) - 1, pack(gathered))
        gathered.clear()

    for position, blocks in enumerate(episodes):
        n_values = sum(block.size for block in (*gathered, *blocks))
        if gathered and n_values > CHUNK_VALUES:
            write()
        if not gathered:
            starts.append(position)
        gathered += blocks
    if gathered:
        write()
    return starts


def _recorded(spec: Spec, episodes: Sequence[Episode], folder: Path) -> dict[str, Any]:
    columns = SeriesColumns(spec, episodes)
    starts = _write_chunks(([columns.moving(episode)] for episode in episodes), folder)
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


def pack(blocks: Sequence[NDArray[np.integer]], order: int = 2) -> str:
    """Packs blocks of integers, one after the other, without their shapes.

    Args:
        blocks: each [T, C], of 16 bits; other values wrap.
        order: how many times columns are replaced by their differences along time.

    Returns:
        Base64 of the gzip of all low bytes, then all high bytes. Values are column after column,
        and zigzag encoded: 0, -1, 1, -2 are 0, 1, 2, 3. `assets/data.js` unpacks it.
    """
    columns = []
    for block in blocks:
        found = block.astype(np.int64)
        for _ in range(order):
            found = np.diff(found, axis=0, prepend=0)
        columns.append(found.T.ravel())
    values = np.concatenate(columns).astype(np.int16) if columns else np.zeros(0, np.int16)
    codes = ((values << 1) ^ (values >> 15)).astype(np.uint16)
    split = (codes & 255).astype(np.uint8).tobytes() + (codes >> 8).astype(np.uint8).tobytes()
    return base64.b64encode(gzip.compress(split, 9, mtime=0)).decode()
