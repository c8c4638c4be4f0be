"""D4RL-style HDF5 files, one for each agent, for tools that learn a single agent. Written only.

A folder with `<agent>.hdf5`: the agent's own observations, actions, rewards and ends, without
padding. Where agents leave, a file ends the agent's episode when it left and has no rows behind it.
Each file can be read again with the format `d4rl`, as the data of one agent.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.hdf5 import created
from swarmdata.interop.conversion.kept_facts import FACTS, NEXT, Arrays, blocks
from swarmdata.interop.conversion.space_columns import agents_of
from swarmdata.interop.formats import Format
from swarmdata.specs.spaces import width

KEPT = {
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
LOST = {name: "each file holds one agent" for name in FACTS if name not in KEPT}

_CHUNK_ROWS = 4096


def write(dataset: Dataset, path: Path) -> None:
    """Writes a view as one HDF5 file per agent."""
    path.mkdir()
    agents = agents_of(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    for index, agent in enumerate(agents):
        with created(path / f"{agent.name}.hdf5") as writer:
            sizes = width(agent.observation), width(agent.action)
            for _, arrays in blocks(dataset):
                for key, values in _rows(arrays, index, *sizes).items():
                    _append(writer.file, key, values)
                writer.check()


def _rows(arrays: Arrays, agent: int, n_columns: int, action_size: int) -> dict[str, NDArray[Any]]:
    """The rows of one agent while it is there."""
    columns = {
        "observations": arrays["observations"][:, agent, :n_columns],
        "next_observations": arrays[NEXT + "observations"][:, agent, :n_columns],
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
        columns["infos/next_states"] = arrays[NEXT + "states"]
    if "log_probs" in arrays:
        columns["infos/action_log_probs"] = arrays["log_probs"][:, agent]
    if "alive" not in arrays:
        return columns
    here = arrays["alive"][:, agent]
    return {key: values[here] for key, values in columns.items()}


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


FORMAT = Format("d4rl-agents", "D4RL-style HDF5 per agent", KEPT, LOST, None, write)
