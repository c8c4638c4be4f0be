"""Reads D4RL-style HDF5 files that this library did not write."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.block_reader import BlockReader
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices

REQUIRED_KEYS = ("observations", "actions", "rewards", "terminals")
_AGENT_ARRAYS = ("observations", "actions", "next_observations")


def read_foreign_file(file: Any, source: Path, task: str, choices: Choices) -> ImportedData:
    """Imports flat arrays: of one agent, of several concatenated agents, or with an agent axis.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    _check_lengths(file, source)
    n_agents = _count_agents(file, source, choices)
    columns = {
        name: int(np.prod(file[name].shape[1:])) // n_agents
        for name in _AGENT_ARRAYS
        if name in file
    }
    is_discrete = file["actions"].dtype.kind in "iu"
    shapes = AgentShapes(
        observations=(columns["observations"],) * n_agents,
        actions=(columns["actions"],) * n_agents,
        choices=int(file["actions"][:].max()) + 1 if is_discrete else 0,
        states=0,
    )
    terminals = _for_agents(file["terminals"][:], n_agents, np.bool_)
    timeouts = None
    if "timeouts" in file:
        timeouts = _for_agents(file["timeouts"][:], n_agents, np.bool_)
    rows = _reader(file, columns, n_agents)
    has_next = "next_observations" in file
    return import_without_note(
        task, shapes, [Timeline(str(source), terminals, timeouts, rows, has_next)], choices
    )


def _check_lengths(file: Any, source: Path) -> None:
    for name in REQUIRED_KEYS:
        if name not in file:
            raise ConversionError(
                f"{source} has no {name!r}, expected D4RL's keys observations, actions, rewards, "
                f"terminals and timeouts; it has {', '.join(sorted(file))}"
            )
    names = (*REQUIRED_KEYS, "timeouts", "next_observations")
    counts = {name: len(file[name]) for name in names if name in file}
    if len(set(counts.values())) != 1:
        raise ConversionError(f"{source} has arrays of different lengths: {counts}")


def _count_agents(file: Any, source: Path, choices: Choices) -> int:
    """Number of agents: from the agent axis, else from the user, else one."""
    shape = file["observations"].shape
    if len(shape) not in (2, 3):
        raise ConversionError(
            f"{source} has observations of shape {shape}, expected [n, O], [n, N * O] or [n, N, O]"
        )
    n_agents = int(shape[1]) if len(shape) == 3 else choices.n_agents or 1
    if choices.n_agents not in (None, n_agents):
        raise ConversionError(
            f"{source} has observations of shape {shape}, which does not fit "
            f"{choices.n_agents} agents"
        )
    for name in ("observations", "actions"):
        if int(np.prod(file[name].shape[1:])) % n_agents:
            raise ConversionError(
                f"{source} has {name} of shape {file[name].shape}, which cannot be divided among "
                f"{n_agents} agents"
            )
    return n_agents


def _reader(file: Any, columns: Mapping[str, int], n_agents: int) -> BlockReader:
    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        found: dict[str, NDArray[Any]] = {
            name: file[name][window].reshape(-1, n_agents, width).astype(np.float32)
            for name, width in columns.items()
        }
        found["rewards"] = _for_agents(file["rewards"][window], n_agents, np.float32)
        return found

    return BlockReader(rows, len(file["actions"]), 4 * n_agents * (1 + sum(columns.values())))


def _for_agents(values: NDArray[Any], n_agents: int, dtype: Any) -> NDArray[Any]:
    """Repeats a team's column for every agent, [n, N]."""
    columns = values.reshape(len(values), -1).astype(dtype)
    return np.broadcast_to(columns, (len(values), n_agents)).copy()
