"""LeRobot datasets (layout v3.0): Parquet files of frames, and JSON about them. Write only.

The team is one robot: `observation.state` has the observations of all agents one after another,
`action` their actions, `observation.environment_state` the global state, and `next.reward` the mean
reward; `agent_rewards` keeps those of each agent. Episodes are ordered by split, since LeRobot's
splits are ranges. A frame is a step, so the observation after the last action is not there.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.hub.publishing.metadata.episode_parquet import arrow
from swarmdata.interop.conversion.dataset_facts import (
    DATASET_FACTS,
    NOTED_FACTS,
    Arrays,
    recorded_agents,
)
from swarmdata.interop.conversion.export_note import NOTE_FILE, write_note
from swarmdata.interop.formats import Format
from swarmdata.interop.parquet import list_column
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.specs.spaces import width
from swarmdata.store import SPLITS
from swarmdata.types import Episode

LAYOUT_VERSION = "v3.0"

FILE_BYTES = 100 << 20
"""A file of frames holds at most about so many bytes of numbers, as LeRobot's own."""

CHUNK_FILES = 1000  # files in a folder, as LeRobot has

GROUP_EPISODES = 64  # rows of the table of episodes that are in memory together

KEPT_NAMES = {
    "observations": "observation.state, without the last",
    "states": "observation.environment_state, without the last",
    "actions": "action",
    "rewards": "agent_rewards",
    "terminations": "next.done",
    "truncations": "next.truncated",
    **dict.fromkeys(NOTED_FACTS, f"meta/{NOTE_FILE}"),
}
LOST_REASONS = {
    name: "LeRobot has no such features" for name in DATASET_FACTS if name not in KEPT_NAMES
}

_DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES_FILE = "meta/episodes/chunk-000/file-000.parquet"


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one LeRobot dataset."""
    fps = _fps(dataset)
    order = np.argsort(dataset.episodes.split, kind="stable")
    dataset = replace(dataset, selection=dataset.selection[order])
    (path / _EPISODES_FILE).parent.mkdir(parents=True)
    stats = _write_episodes(_write_frames(dataset, path, fps), path / _EPISODES_FILE)
    _write_tasks(path / "meta/tasks.parquet", dataset.spec.task)
    for name, content in (("info", _info(dataset, fps)), ("stats", stats)):
        text = json.dumps(content, indent=4)
        (path / f"meta/{name}.json").write_text(text, encoding="utf-8")
    write_note(dataset, path / "meta", frame)


def _fps(dataset: Dataset) -> int:
    """Steps a second; 1 where that is not known."""
    rate = 1.0 / (dataset.spec.time_step or 1.0)
    if abs(rate - round(rate)) > 1e-6:
        raise ConversionError(
            f"{dataset.id} has {rate:g} steps a second, and LeRobot counts whole ones only. "
            "Choose another format."
        )
    return round(rate)


def _files(dataset: Dataset) -> Iterator[Dataset]:
    """Consecutive episodes of about `FILE_BYTES`."""
    lengths, arrays = dataset.episodes.lengths, dataset.stored.arrays
    per_step = sum(
        arrays[name].nbytes // len(arrays[name]) for name in ("observations", "states", "actions")
    )
    numbers = (np.cumsum(lengths) - lengths) * per_step // FILE_BYTES
    for number in np.unique(numbers):
        yield replace(dataset, selection=dataset.selection[numbers == number])


def _write_episodes(rows: Iterator[dict[str, Any]], file: Path) -> dict[str, dict[str, Any]]:
    """Writes the table of episodes; returns statistics of all frames, by feature."""
    library, total = arrow(), list[dict[str, Any]]()
    with ExitStack() as stack:
        while some := list(islice(rows, GROUP_EPISODES)):
            table = library.Table.from_pylist(some)
            if not total:
                writer = stack.enter_context(library.parquet.ParquetWriter(file, table.schema))
            writer.write_table(table)
            total = [_joined([*total, *some])]
    found: dict[str, dict[str, Any]] = {}
    for key, value in total[0].items():
        _, name, what = key.split("/")
        found.setdefault(name, {})[what] = value
    return found


def _write_frames(dataset: Dataset, path: Path, fps: int) -> Iterator[dict[str, Any]]:
    """Writes the files of frames; yields the row of each episode."""
    library, n_episodes, frame = arrow(), 0, 0
    reads = MappedReads(dataset.stored.arrays.values())
    for number, part in enumerate(_files(dataset)):
        place = {"chunk_index": number // CHUNK_FILES, "file_index": number % CHUNK_FILES}
        file = path / _DATA_PATH.format(**place)
        file.parent.mkdir(parents=True, exist_ok=True)
        schema = _table(_columns(part, part[0], 0, 0, fps)).schema
        with library.parquet.ParquetWriter(file, schema) as writer:
            for episode in part:
                columns = _columns(dataset, episode, n_episodes, frame, fps)
                writer.write_table(_table(columns))
                yield _episode_row(dataset.spec.task, place, columns)
                n_episodes, frame = n_episodes + 1, frame + len(episode)
                reads.add(episode.observations, episode.states, episode.actions)


def _columns(dataset: Dataset, episode: Episode, number: int, frame: int, fps: int) -> Arrays:
    """All features of an episode's frames, those that LeRobot adds included."""
    agents = recorded_agents(dataset.spec, episode.observations.shape[2])
    observed = [
        episode.observations[:-1, k, : width(agent.observation)] for k, agent in enumerate(agents)
    ]
    acted = [episode.actions[:, k, : width(agent.action)] for k, agent in enumerate(agents)]
    steps = np.arange(len(episode))
    columns = {
        "observation.state": np.concatenate(observed, axis=1),
        "action": np.concatenate(acted, axis=1),
        "agent_rewards": episode.rewards,
        "next.reward": episode.rewards.mean(axis=1, dtype=np.float32),
        "next.done": episode.terminations,
        "next.truncated": episode.truncations,
    }
    if episode.states.size:
        columns["observation.environment_state"] = episode.states[:-1]
    return columns | {
        "timestamp": (steps / fps).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full(len(steps), number),
        "index": frame + steps,
        "task_index": np.zeros(len(steps), np.int64),
    }


def _table(columns: Arrays) -> Any:
    """Rows of numbers are lists of fixed length; one number is no list."""
    flat = {
        name: values[:, 0] if values.ndim > 1 and values.shape[1] == 1 else values
        for name, values in columns.items()
    }
    return arrow().table({name: list_column(values) for name, values in flat.items()})


def _episode_row(task: str, place: Mapping[str, int], columns: Arrays) -> dict[str, Any]:
    """What `meta/episodes` says of an episode, statistics of its frames included."""
    n, first = len(columns["action"]), int(columns["index"][0])
    row: dict[str, Any] = {
        "episode_index": int(columns["episode_index"][0]),
        "tasks": [task],
        "length": n,
        **{f"data/{key}": value for key, value in place.items()},
        "dataset_from_index": first,
        "dataset_to_index": first + n,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, values in columns.items():
        rows = values.reshape(n, -1).astype(np.float64)
        found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
        row |= {f"stats/{name}/{key}": value.tolist() for key, value in found.items()}
        row[f"stats/{name}/count"] = [n]
    return row


def _joined(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The statistics of some rows of episodes as those of one."""
    names = [key.split("/")[1] for key in rows[0] if key.endswith("/count")]
    found: dict[str, Any] = {}
    for name in names:
        counts, lows, highs, means, stds = (
            np.array([row[f"stats/{name}/{key}"] for row in rows], np.float64)
            for key in ("count", "min", "max", "mean", "std")
        )
        share = counts / counts.sum()
        mean = (share * means).sum(0)
        spread = (share * (stds * stds + (means - mean) ** 2)).sum(0)
        joined = {"min": lows.min(0), "max": highs.max(0), "mean": mean, "std": np.sqrt(spread)}
        found |= {f"stats/{name}/{key}": value.tolist() for key, value in joined.items()}
        found[f"stats/{name}/count"] = [int(counts.sum())]
    return found


def _info(dataset: Dataset, fps: int) -> dict[str, Any]:
    lengths, splits = dataset.episodes.lengths, dataset.episodes.split
    ends = np.cumsum(np.bincount(splits, minlength=len(SPLITS))).tolist()
    bounds = zip(SPLITS, [0, *ends], ends, strict=False)
    ranges = {name: f"{first}:{stop}" for name, first, stop in bounds if first < stop}
    return {
        "codebase_version": LAYOUT_VERSION,
        "robot_type": "swarmdata",
        "total_episodes": len(lengths),
        "total_frames": int(lengths.sum()),
        "total_tasks": 1,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_BYTES >> 20,
        "video_files_size_in_mb": 0,
        "fps": fps,
        "splits": ranges,
        "data_path": _DATA_PATH,
        "video_path": None,
        "features": _described(dataset, fps),
    }


def _described(dataset: Dataset, fps: int) -> dict[str, Any]:
    """Type, shape and names of the numbers of every feature."""
    columns, names = _columns(dataset, dataset[0], 0, 0, fps), _names(dataset)
    return {
        name: {
            "dtype": str(values.dtype),
            "shape": [values.shape[1] if values.ndim > 1 else 1],
            "names": names.get(name),
        }
        for name, values in columns.items()
    }


def _names(dataset: Dataset) -> dict[str, list[str]]:
    """Names of the numbers of a feature, with that of their agent."""
    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    known = () if dataset.spec.world is None else features_of(make_task(dataset.spec.world))
    words = [feature.name for feature in known]
    return {
        "observation.state": [
            f"{agent.name}.{words[k] if k < len(words) else k}"
            for agent in agents
            for k in range(width(agent.observation))
        ],
        "action": [f"{agent.name}.{k}" for agent in agents for k in range(width(agent.action))],
        "agent_rewards": [agent.name for agent in agents],
    }


def _write_tasks(path: Path, task: str) -> None:
    """The table of tasks, whose index is the task's name, as pandas would write it."""
    library = arrow()
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": dtype,
         "metadata": None}
        for name, kind, dtype in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]  # fmt: skip
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    table = library.table({"task_index": [0], "task": [task]})
    table = table.replace_schema_metadata({"pandas": json.dumps(pandas)})
    library.parquet.write_table(table, path)


FORMAT = Format("lerobot", "LeRobot (v3.0)", KEPT_NAMES, LOST_REASONS, None, write)
