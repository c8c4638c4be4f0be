"""D4RL-style HDF5 files, one for each agent, for tools that learn a single agent. Write only.

A folder with files `<agent>.hdf5`, which hold the agent's own observations, actions, rewards and
ends, without padding. If an agent leaves, its episode ends in the file when it left. Each file can
be read again with the format `d4rl`, as the data of one agent.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.dataset_facts import (
    DATASET_FACTS,
    NEXT_PREFIX,
    Arrays,
    recorded_agents,
    step_blocks,
)
from swarmdata.interop.conversion.hdf5_writer import create_hdf5
from swarmdata.interop.formats import Format
from swarmdata.specs.spaces import width

KEPT_NAMES = {
    "observations": "observations",
    "states": "infos/states",
    "actions": "actions",
    "log_probs": "infos/action_log_probs",
    "rewards": "rewards",
    "terminations": "terminals",
    "truncations": "timeouts",
    "agent_terminations": "terminals",
    "agent_truncations": "timeouts",
}
LOST_REASONS = {
    name: "each file holds one agent" for name in DATASET_FACTS if name not in KEPT_NAMES
}

_CHUNK_ROWS = 4096


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one HDF5 file per agent."""
    path.mkdir()
    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    for index, agent in enumerate(agents):
        with create_hdf5(path / f"{agent.name}.hdf5") as (file, check):
            file["metadata/frame"] = frame  # other formats have it in their note
            sizes = width(agent.observation), width(agent.action)
            for _, arrays in step_blocks(dataset):
                for key, values in _rows(arrays, index, *sizes).items():
                    _append(file, key, values)
                check()


def _rows(arrays: Arrays, agent: int, n_columns: int, action_size: int) -> dict[str, NDArray[Any]]:
    """The rows in which one agent is alive."""
    columns = {
        "observations": arrays["observations"][:, agent, :n_columns],
        "next_observations": arrays[NEXT_PREFIX + "observations"][:, agent, :n_columns],
        "actions": arrays["actions"][:, agent, :action_size],
        "rewards": arrays["rewards"][:, agent],
        "terminals": arrays["terminations"],
        "timeouts": arrays["truncations"],
    }
    if "agent_terminations" in arrays:
        columns["terminals"] = arrays["agent_terminations"][:, agent]
        columns["timeouts"] = arrays["agent_truncations"][:, agent]
    if "states" in arrays:
        columns["infos/states"] = arrays["states"]
        columns["infos/next_states"] = arrays[NEXT_PREFIX + "states"]
    if "log_probs" in arrays:
        columns["infos/action_log_probs"] = arrays["log_probs"][:, agent]
    if "alive" not in arrays:
        return columns
    alive = arrays["alive"][:, agent]
    return {key: values[alive] for key, values in columns.items()}


def _append(file: Any, key: str, values: NDArray[Any]) -> None:
    if key not in file:
        shape, chunks = values.shape[1:], (_CHUNK_ROWS, *values.shape[1:])
        file.create_dataset(
            key, (0, *shape), values.dtype, maxshape=(None, *shape), chunks=chunks, fletcher32=True
        )
    target = file[key]
    first = len(target)
    target.resize(first + len(values), axis=0)
    target[first:] = np.ascontiguousarray(values)


FORMAT = Format("d4rl-agents", "D4RL-style HDF5 per agent", KEPT_NAMES, LOST_REASONS, None, write)
