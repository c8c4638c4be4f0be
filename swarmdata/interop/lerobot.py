"""LeRobot datasets (layout v3.0): Parquet files of frames, and JSON about them. Write only.

The team is one robot: `observation.state` has the observations of all agents one after another,
`action` their actions, `observation.environment_state` the global state, and `next.reward` the mean
reward; `agent_rewards` keeps those of each agent. Episodes are ordered by split, since LeRobot's
splits are ranges. A frame is a step, so the observation after the last action is not there.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.hub.publishing.metadata.episode_parquet import arrow
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS, Arrays, step_blocks
from swarmdata.interop.conversion.export_note import note_of
from swarmdata.interop.conversion.space_columns import recorded_agents
from swarmdata.interop.formats import Format
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.spaces import width
from swarmdata.store import SPLITS

LAYOUT_VERSION = "v3.0"

NOTE_FILE = "meta/swarmdata.json"

FILE_BYTES = 100 << 20
"""A file of frames holds at most about so many bytes of numbers, as LeRobot's own."""

CHUNK_FILES = 1000
"""Files in a folder, likewise."""

KEPT_NAMES = {
    "observations": "observation.state, without the last",
    "states": "observation.environment_state, without the last",
    "actions": "action",
    "rewards": "agent_rewards",
    "terminations": "next.done",
    "truncations": "next.truncated",
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), NOTE_FILE),
}
LOST_REASONS = {
    name: "LeRobot has no such features" for name in DATASET_FACTS if name not in KEPT_NAMES
}

_DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES_FILE = "meta/episodes/chunk-000/file-000.parquet"

Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Part:
    """The episodes of one file of frames."""

    number: int
    first_episode: int
    first_frame: int
    view: Dataset

    @property
    def place(self) -> dict[str, int]:
        """Numbers of its chunk and of the file in it."""
        return {"chunk_index": self.number // CHUNK_FILES, "file_index": self.number % CHUNK_FILES}


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one LeRobot dataset.

    Raises:
        ConversionError: the robots do not act a whole number of times a second.
        MissingExtraError: the extra `parquet` is not installed.
    """
    library, fps = arrow(), _fps(dataset)
    order = np.argsort(dataset.episodes.split, kind="stable")
    dataset = replace(dataset, selection=dataset.selection[order])
    (path / _EPISODES_FILE).parent.mkdir(parents=True)
    rows: list[dict[str, Any]] = []
    for part in _parts(dataset):
        rows += _write_frames(part, path, fps)
    library.parquet.write_table(library.Table.from_pylist(rows), path / _EPISODES_FILE)
    _write_tasks(path / "meta/tasks.parquet", dataset.spec.task)
    for name, content in (
        ("meta/info.json", _info(dataset, fps)),
        ("meta/stats.json", _total(rows)),
    ):
        (path / name).write_text(json.dumps(content, indent=4), encoding="utf-8")
    (path / NOTE_FILE).write_text(note_of(dataset, frame).to_json(), encoding="utf-8")


def _fps(dataset: Dataset) -> int:
    """Steps a second; 1 where that is not known."""
    rate = 1.0 / (dataset.spec.time_step or 1.0)
    if abs(rate - round(rate)) > 1e-6:
        raise ConversionError(
            f"{dataset.id} has {rate:g} steps a second, and LeRobot counts whole ones only. "
            "Choose another format."
        )
    return round(rate)


def _parts(dataset: Dataset) -> Iterator[Part]:
    """Consecutive episodes of about `FILE_BYTES`."""
    lengths = dataset.episodes.lengths
    arrays = dataset.stored.arrays
    per_step = sum(
        arrays[name].nbytes // len(arrays[name]) for name in ("observations", "states", "actions")
    )
    ends = np.cumsum(lengths)
    numbers = (ends - lengths) * per_step // FILE_BYTES
    for number, code in enumerate(np.unique(numbers)):
        chosen = np.flatnonzero(numbers == code)
        first = int(chosen[0])
        view = replace(dataset, selection=dataset.selection[chosen])
        yield Part(number, first, int(ends[first] - lengths[first]), view)


def _write_frames(part: Part, path: Path, fps: int) -> list[dict[str, Any]]:
    """Writes a file of frames; returns the rows of its episodes."""
    library = arrow()
    file = path / _DATA_PATH.format(**part.place)
    file.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    writer, frame = None, part.first_frame
    lengths = iter(part.view.episodes.lengths.tolist())
    try:
        for _, arrays in step_blocks(part.view):
            left = _features(arrays, part.view)
            while len(left["action"]):
                n, episode = next(lengths), part.first_episode + len(rows)
                columns = {
                    **{name: values[:n] for name, values in left.items()},
                    **_counters(n, episode, frame, fps),
                }
                left = {name: values[n:] for name, values in left.items()}
                table = library.table({name: _column(each) for name, each in columns.items()})
                writer = writer or library.parquet.ParquetWriter(file, table.schema)
                writer.write_table(table)
                rows.append(_episode_row(part, episode, frame, columns))
                frame += n
    finally:
        if writer is not None:
            writer.close()
    return rows


def _features(arrays: Arrays, dataset: Dataset) -> Columns:
    """The features of some steps, one row a step."""
    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    observed = [
        arrays["observations"][:, k, : width(agent.observation)] for k, agent in enumerate(agents)
    ]
    acted = [arrays["actions"][:, k, : width(agent.action)] for k, agent in enumerate(agents)]
    columns = {
        "observation.state": np.concatenate(observed, axis=1),
        "action": np.concatenate(acted, axis=1),
        "agent_rewards": arrays["rewards"],
        "next.reward": arrays["rewards"].mean(axis=1, dtype=np.float32),
        "next.done": arrays["terminations"],
        "next.truncated": arrays["truncations"],
    }
    if "states" in arrays:
        columns["observation.environment_state"] = arrays["states"]
    return columns


def _counters(n: int, episode: int, frame: int, fps: int) -> Columns:
    """The columns that LeRobot adds, of an episode of n steps."""
    steps = np.arange(n)
    return {
        "timestamp": (steps / fps).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full(n, episode),
        "index": frame + steps,
        "task_index": np.zeros(n, np.int64),
    }


def _column(values: NDArray[Any]) -> Any:
    """Rows of numbers as lists of fixed length; one number is no list."""
    library = arrow()
    flat = library.array(np.ascontiguousarray(values).reshape(-1))
    if values.ndim == 1 or values.shape[1] == 1:
        return flat
    return library.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _episode_row(part: Part, episode: int, frame: int, columns: Columns) -> dict[str, Any]:
    """What `meta/episodes` says of an episode, statistics of its frames included."""
    n = len(columns["action"])
    row: dict[str, Any] = {
        "episode_index": episode,
        "tasks": [part.view.spec.task],
        "length": n,
        **{f"data/{key}": value for key, value in part.place.items()},
        "dataset_from_index": frame,
        "dataset_to_index": frame + n,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, values in columns.items():
        rows = values.reshape(n, -1).astype(np.float64)
        found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
        row |= {f"stats/{name}/{key}": value.tolist() for key, value in found.items()}
        row[f"stats/{name}/count"] = [n]
    return row


def _total(rows: list[dict[str, Any]]) -> dict[str, dict[str, list[float]]]:
    """Statistics of all frames from those of the episodes, by feature."""
    names = [key.split("/")[1] for key in rows[0] if key.endswith("/count")]
    counts = np.array([row["length"] for row in rows], np.float64)[:, None]
    share, found = counts / counts.sum(), {}
    for name in names:
        lows, highs, means, stds = (
            np.array([row[f"stats/{name}/{key}"] for row in rows])
            for key in ("min", "max", "mean", "std")
        )
        mean = (share * means).sum(0)
        spread = (share * (stds * stds + (means - mean) ** 2)).sum(0)
        found[name] = {
            "min": lows.min(0).tolist(),
            "max": highs.max(0).tolist(),
            "mean": mean.tolist(),
            "std": np.sqrt(spread).tolist(),
            "count": [int(counts.sum())],
        }
    return found


def _info(dataset: Dataset, fps: int) -> dict[str, Any]:
    lengths, splits = dataset.episodes.lengths, dataset.episodes.split
    ranges = {
        name: f"{first}:{first + count}"
        for code, name in enumerate(SPLITS)
        if (count := int((splits == code).sum()))
        for first in [int((splits < code).sum())]
    }
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
    _, arrays = next(step_blocks(replace(dataset, selection=dataset.selection[:1])))
    columns = {**_features(arrays, dataset), **_counters(1, 0, 0, fps)}
    names = _names(dataset)
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
    column = {"name": "task", "field_name": "task", "pandas_type": "unicode",
              "numpy_type": "object", "metadata": None}  # fmt: skip
    number = {"name": "task_index", "field_name": "task_index", "pandas_type": "int64",
              "numpy_type": "int64", "metadata": None}  # fmt: skip
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": [number, column]}
    table = library.table({"task_index": [0], "task": [task]})
    table = table.replace_schema_metadata({"pandas": json.dumps(pandas)})
    library.parquet.write_table(table, path)


FORMAT = Format("lerobot", "LeRobot (v3.0)", KEPT_NAMES, LOST_REASONS, None, write)
