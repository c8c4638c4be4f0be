"""D4RL-style HDF5: flat arrays over time with `terminals` and `timeouts`.

Files are written for tools that expect one agent: joint observations [n, N * O], joint actions
[n, N * A], and the team's rewards and costs [n]. Everything else is in `infos/`, which D4RL's
loaders read as further keys. Such files are read, as well as files with an agent axis, and files of
one agent as in D4RL (Fu et al. 2020, "D4RL: Datasets for Deep Data-Driven Reinforcement Learning",
and its repository). `next_observations` is written, so that no transition is lost; if a file lacks
them or `timeouts`, the user is asked.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import (
    NEXT_PREFIX,
    NOTED_FACTS,
    Arrays,
    row_shapes,
    step_blocks,
    time_keys,
)
from swarmdata.interop.conversion.export_note import (
    check_team_rewards,
    import_with_note,
    note_text,
    parse_note,
)
from swarmdata.interop.conversion.foreign_data import BlockReader, Timeline, import_without_note
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import check_lengths, flags_of, team_shapes
from swarmdata.interop.conversion.hdf5_reader import numbers, open_hdf5
from swarmdata.interop.conversion.hdf5_writer import create_hdf5
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.numerics.event_costs import costs_of

NOTE_KEY, LAYOUTS_KEY = "metadata/swarmdata", "metadata/layouts"

KEPT_NAMES = {
    "observations": "observations",
    "states": "infos/states",
    "sent": "infos/sent",
    "delivered": "infos/delivered",
    "ages": "infos/message_ages",
    "actions": "actions",
    "log_probs": "infos/action_log_probs",
    "rewards": "infos/agent_rewards",
    "reward_terms": "infos/reward_terms",
    "terminations": "terminals",
    "truncations": "timeouts",
    "events": "infos/events",
    "alive": "infos/alive",
    "action_masks": "infos/action_masks",
    "agent_terminations": "infos/agent_terminals",
    "agent_truncations": "infos/agent_timeouts",
    "layout": LAYOUTS_KEY,
    **dict.fromkeys(NOTED_FACTS, NOTE_KEY),
}


def _next(key: str) -> str:
    folder, slash, last = key.rpartition("/")
    return f"{folder}{slash}{NEXT_PREFIX}{last}"


_TIME_KEYS = time_keys(KEPT_NAMES, _next)

_CHUNK_ROWS = 4096


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one HDF5 file."""
    with create_hdf5(path) as (file, check):
        shapes = row_shapes(dataset)
        for name, (shape, dtype) in shapes.items():
            flat = (int(np.prod(shape)),) if _is_joint(name) else shape
            _create(file, _TIME_KEYS[name], dataset.n_steps, flat, dtype)
        for name in ("rewards", "costs") if "events" in shapes else ("rewards",):  # as in DSRL
            _create(file, name, dataset.n_steps, (), np.dtype(np.float32))
        for first, arrays in step_blocks(dataset):
            rows = slice(first, first + len(arrays["rewards"]))
            for name, values in arrays.items():
                flat_values = values.reshape(len(values), -1) if _is_joint(name) else values
                file[_TIME_KEYS[name]][rows] = flat_values
            team = arrays["rewards"].mean(axis=1, dtype=np.float64)
            file["rewards"][rows] = team.astype(np.float32)
            if "events" in arrays and (costs := costs_of(arrays["events"])) is not None:
                file["costs"][rows] = costs.sum(axis=(1, 2))
            check()
        file[NOTE_KEY] = note_text(dataset, frame)
        layouts = dataset.episodes.layouts
        if layouts.size:
            file[LAYOUTS_KEY] = layouts


def _is_joint(name: str) -> bool:
    return name.removeprefix(NEXT_PREFIX) in ("observations", "actions")


def _create(file: Any, key: str, n_rows: int, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    chunks = (min(n_rows, _CHUNK_ROWS), *shape)
    file.create_dataset(key, (n_rows, *shape), dtype, chunks=chunks, fletcher32=True)


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens a file that this library or others wrote in the style of D4RL."""
    with open_hdf5(source) as file:
        if NOTE_KEY in file:
            yield _read_exported(file, source)
        else:
            yield read_foreign_file(file, source, task, choices)


def _read_exported(file: Any, source: Path) -> ImportedData:
    with reading(source):
        text = file[NOTE_KEY][()]
    note = parse_note(text, source)
    keys = {name: key for name, key in _TIME_KEYS.items() if key in file}
    arrays = {name: numbers(file, key, source) for name, key in keys.items()}
    n = check_lengths({keys[name]: len(each) for name, each in arrays.items()}, str(source))
    n_agents = len(note.spec.agent_names)

    team = numbers(file, "rewards", source)

    def rows(window: slice) -> Arrays:
        found = {name: each[window] for name, each in arrays.items()}
        check_team_rewards(team[window], found["rewards"], f"{source}, from row {window.start}")
        return {
            name: values.reshape(len(values), n_agents, -1) if _is_joint(name) else values
            for name, values in found.items()
        }

    layouts = numbers(file, LAYOUTS_KEY, source)[:] if LAYOUTS_KEY in file else None
    row_bytes = sum(each.nbytes // n for each in arrays.values())
    return import_with_note(note, BlockReader(rows, n, row_bytes, source), n, str(source), layouts)


_REQUIRED_KEYS = ("observations", "actions", "rewards", "terminals")
_OPTIONAL_KEYS = ("timeouts", "next_observations")


def read_foreign_file(file: Any, source: Path, task: str, choices: Choices) -> ImportedData:
    """Imports flat arrays: of one agent, of several concatenated agents, or with an agent axis."""
    absent = [name for name in _REQUIRED_KEYS if name not in file]
    if absent:
        raise ConversionError(
            f"{source} has no {absent[0]!r}, expected D4RL's keys observations, actions, rewards, "
            f"terminals and timeouts; it has {', '.join(sorted(file))}"
        )
    names = [name for name in (*_REQUIRED_KEYS, *_OPTIONAL_KEYS) if name in file]
    arrays = {name: numbers(file, name, source) for name in names}
    n = check_lengths({name: len(each) for name, each in arrays.items()}, str(source))
    shapes = team_shapes(arrays["observations"].shape, arrays["actions"], choices, str(source))
    n_agents = len(shapes.observations)
    row_bytes = sum(each.nbytes // n for each in arrays.values())
    with reading(source):
        stored = {name: arrays.pop(name)[:] for name in ("terminals", "timeouts") if name in arrays}
    flags = {name: flags_of(each, n_agents, f"{source}: {name}") for name, each in stored.items()}

    def rows(window: slice) -> Arrays:
        return {name: each[window] for name, each in arrays.items()}

    reader = BlockReader(rows, n, row_bytes, source)
    timeline = Timeline(
        str(source), flags["terminals"], flags.get("timeouts"), reader,
        has_next="next_observations" in arrays,
    )  # fmt: skip
    found: list[str] = []  # all arrays, those in groups with the group's name
    file.visititems(lambda name, each: found.append(name) if hasattr(each, "dtype") else None)
    unread = [name for name in found if name not in names]
    return import_without_note(task, shapes, [timeline], choices, unread=unread)


FORMAT = Format("d4rl", "D4RL-style HDF5", KEPT_NAMES, {}, read, write)
