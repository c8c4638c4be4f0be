"""D4RL-style HDF5: flat arrays over time with `terminals` and `timeouts`.

Written for tools that expect one agent, so jointly: observations [n, N * O], actions [n, N * A],
rewards [n] the team's. The rest lies in `infos/`, which D4RL's loaders read as further keys. Read:
such files, files with an agent axis, and files of one agent as D4RL has them (Fu et al. 2020,
"D4RL: Datasets for Deep Data-Driven Reinforcement Learning", and its repository). We write
`next_observations`, so that no transition has to be left out; where a file lacks them or
`timeouts`, the user is asked.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.hdf5 import created
from swarmdata.interop.conversion.incoming import Incoming
from swarmdata.interop.conversion.kept_facts import (
    NEXT,
    STATE_ARRAYS,
    TIME_ARRAYS,
    blocks,
    row_shapes,
)
from swarmdata.interop.conversion.note import note_of, parse_note
from swarmdata.interop.conversion.noted_data import noted
from swarmdata.interop.conversion.read_ahead import Ahead
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.d4rl.d4rl_foreign import unnoted_file
from swarmdata.interop.formats import Format

NOTE, LAYOUTS = "metadata/swarmdata", "metadata/layouts"

KEPT = {
    "observations": "observations",
    "states": "infos/states",
    "sent": "infos/sent",
    "delivered": "infos/delivered",
    "ages": "infos/message_ages",
    "actions": "actions",
    "log_probs": "infos/action_log_probs",
    "rewards": "infos/agent_rewards",
    "terminations": "terminals",
    "truncations": "timeouts",
    "events": "infos/events",
    "alive": "infos/alive",
    "action_masks": "infos/action_masks",
    "agent_terminations": "infos/agent_terminals",
    "agent_truncations": "infos/agent_timeouts",
    "layout": LAYOUTS,
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), NOTE),
}
LOST: dict[str, str] = {}

_CHUNK_ROWS = 4096


def write(dataset: Dataset, path: Path) -> None:
    """Writes a view as one HDF5 file."""
    with created(path) as writer:
        file = writer.file
        for name, (shape, dtype) in row_shapes(dataset).items():
            if key := _key(name):
                flat = (int(np.prod(shape)),) if _is_joint(name) else shape
                _create(file, key, dataset.n_steps, flat, dtype)
        _create(file, "rewards", dataset.n_steps, (), np.dtype(np.float32))
        for first, arrays in blocks(dataset):
            for name, values in arrays.items():
                if key := _key(name):
                    rows = values.reshape(len(values), -1) if _is_joint(name) else values
                    file[key][first : first + len(rows)] = rows
            team = arrays["rewards"].mean(axis=1, dtype=np.float64)
            file["rewards"][first : first + len(team)] = team.astype(np.float32)
            writer.check()
        file[NOTE] = note_of(dataset).to_json()
        layouts = dataset.episodes.layouts
        if layouts.size:
            file[LAYOUTS] = layouts


def _key(name: str) -> str | None:
    """Where an array of ours lies in the file, None where it is lost."""
    if not name.startswith(NEXT):
        return KEPT.get(name)
    key = KEPT.get(name.removeprefix(NEXT))
    return None if key is None else _next(key)


def _next(key: str) -> str:
    folder, slash, last = key.rpartition("/")
    return f"{folder}{slash}{NEXT}{last}"


def _is_joint(name: str) -> bool:
    return name.removeprefix(NEXT) in ("observations", "actions")


def _create(file: Any, key: str, n_rows: int, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    chunks = (min(n_rows, _CHUNK_ROWS), *shape)
    file.create_dataset(key, (n_rows, *shape), dtype, chunks=chunks, fletcher32=True)


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[Incoming]:
    """Opens a file that this library, D4RL or somebody in its style wrote.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    import h5py  # noqa: PLC0415  (heavy)

    try:
        file = h5py.File(source, "r")
    except OSError as error:
        raise ConversionError(f"{source} is not an HDF5 file that can be read: {error}") from error
    with file:
        yield _noted(file, source) if NOTE in file else unnoted_file(file, source, task, choices)


def _noted(file: Any, source: Path) -> Incoming:
    note = parse_note(file[NOTE][()], source)
    n_agents = file[KEPT["rewards"]].shape[1]
    keys = {name: key for name, key in KEPT.items() if name in TIME_ARRAYS and key in file}
    keys |= {NEXT + name: _next(key) for name, key in keys.items() if name in STATE_ARRAYS}

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        arrays = {name: file[key][window] for name, key in keys.items()}
        return {
            name: values.reshape(len(values), n_agents, -1) if _is_joint(name) else values
            for name, values in arrays.items()
        }

    layouts = file[LAYOUTS][:] if LAYOUTS in file else None
    n = len(file[KEPT["actions"]])
    row_bytes = sum(file[key].nbytes // n for key in keys.values())
    return noted(note, Ahead(rows, n, row_bytes), n, str(source), layouts)


FORMAT = Format("d4rl", "D4RL-style HDF5", KEPT, LOST, read, write)
