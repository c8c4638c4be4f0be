"""Folders of NumPy arrays, one file per agent and quantity, as in OMAR and CFCQL.

Pan et al. 2022, "Plan Better Amid Conservatism" (OMAR), `utils/buffer.py`, and Shao et al. 2023,
"Counterfactual Conservative Q Learning" (CFCQL), `continuous/utils/buffer.py`: `obs_<i>.npy`,
`acs_<i>.npy`, `rews_<i>.npy`, `next_obs_<i>.npy`, `dones_<i>.npy` for each agent i, and with
MuJoCo also `states_<i>.npy` and `next_states_<i>.npy`, the same for every agent. One row per step,
without padding. `dones` marks the last step of every episode, also where a time limit ended it, as
in OMAR's particle data; `swarmdata.json` tells which it was.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import (
    DATASET_FACTS,
    NEXT_PREFIX,
    NOTED_FACTS,
    Arrays,
    recorded_agents,
    step_blocks,
)
from swarmdata.interop.conversion.export_note import (
    NOTE_FILE,
    ExportNote,
    import_with_note,
    read_note,
    write_note,
)
from swarmdata.interop.conversion.foreign_data import Timeline, import_without_note
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import (
    check_lengths,
    columns_of,
    count_choices,
    flags_of,
    pad_agents,
    share_choices,
)
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import DiscreteSpace, MultiDiscreteSpace, width

KEPT_NAMES = {
    "observations": "obs_<i>",
    "states": "states_<i>",
    "actions": "acs_<i>",
    "rewards": "rews_<i>",
    "terminations": "dones_<i>",
    "truncations": "dones_<i>",
    **dict.fromkeys(NOTED_FACTS, NOTE_FILE),
}
LOST_REASONS = {
    name: "OMAR and CFCQL have no such files" for name in DATASET_FACTS if name not in KEPT_NAMES
}


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as one folder."""
    path.mkdir()
    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    n_rows = int(dataset.episodes.lengths.sum())
    files: dict[str, BinaryIO] = {}
    with ExitStack() as stack:
        for _, arrays in step_blocks(dataset):
            for name, values in _columns(arrays, agents):
                if name not in files:
                    files[name] = stack.enter_context((path / f"{name}.npy").open("wb"))
                    header = np.lib.format.header_data_from_array_1_0(values)
                    header |= {"fortran_order": False, "shape": (n_rows, *values.shape[1:])}
                    np.lib.format.write_array_header_1_0(files[name], header)
                files[name].write(np.ascontiguousarray(values).tobytes())
    write_note(dataset, path, frame)


def _columns(arrays: Arrays, agents: Sequence[RecordedAgent]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and rows of every file."""
    dones = (arrays["terminations"] | arrays["truncations"]).astype(np.float32)
    for k, agent in enumerate(agents):
        n_columns, action = width(agent.observation), agent.action
        acts = arrays["actions"][:, k, : width(action)]
        is_choice = isinstance(action, DiscreteSpace | MultiDiscreteSpace)
        yield f"obs_{k}", arrays["observations"][:, k, :n_columns]
        yield f"next_obs_{k}", arrays[NEXT_PREFIX + "observations"][:, k, :n_columns]
        yield f"acs_{k}", acts.astype(np.int64) if is_choice else acts
        yield f"rews_{k}", arrays["rewards"][:, k]
        yield f"dones_{k}", dones
        if "states" in arrays:
            yield f"states_{k}", arrays["states"]
            yield f"next_states_{k}", arrays[NEXT_PREFIX + "states"]


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens a folder that this library wrote, one of others, or a folder of several."""
    if (note := read_note(source)) is not None:
        yield _read_exported(source, note)
    else:
        yield read_foreign(source, task, choices)


def _read_exported(source: Path, note: ExportNote) -> ImportedData:
    agents = _agents(source, len(note.spec.agent_names))
    dones = agents[0]["dones"]
    truncated = np.repeat(note.truncated, note.episodes.lengths)

    def rows(window: slice) -> Arrays:
        found, done = _joint(agents, window), dones[window] != 0
        return found | {
            "actions": found["actions"].astype(np.float32),
            "rewards": found["rewards"][..., 0],
            "terminations": done & ~truncated[window],
            "truncations": done & truncated[window],
        }

    return import_with_note(note, rows, len(dones), str(source))


_JOINT_ARRAYS = {
    "obs": "observations",
    "next_obs": "next_observations",
    "acs": "actions",
    "rews": "rewards",
}
_REQUIRED_PREFIXES = (*_JOINT_ARRAYS, "dones")
_STATE_PREFIXES = ("states", "next_states")

Agents = Sequence[Arrays]


def read_foreign(source: Path, task: str, choices: Choices) -> ImportedData:
    """Opens a folder, or a folder of folders in the order of their names."""
    folders = [path.parent for path in (*source.glob("obs_0.npy"), *source.glob("*/obs_0.npy"))]
    if not folders:
        raise ConversionError(
            f"{source} has neither obs_0.npy nor folders with it, expected for each agent i the "
            f"files {', '.join(f'{name}_<i>.npy' for name in _REQUIRED_PREFIXES)}"
        )
    if folders[0] == source:
        folders = [source]
    folders.sort(key=lambda path: ([int(k) for k in re.findall(r"\d+", path.name)], path))
    runs = {folder: _agents(folder, len([*folder.glob("obs_*.npy")])) for folder in folders}
    kinds = {folder: _shapes(folder, agents) for folder, agents in runs.items()}
    shapes = kinds[folders[0]]
    if any(replace(each, choices=shapes.choices) != shapes for each in kinds.values()):
        raise ConversionError(f"the folders of {source} have different shapes: {kinds}")
    counts = share_choices([each for kind in kinds.values() for each in kind.choices])
    shapes = replace(shapes, choices=counts[: len(shapes.choices)])
    timelines = []
    for folder, agents in runs.items():
        dones = [flags_of(a["dones"], 1, f"{folder}: dones_{k}") for k, a in enumerate(agents)]
        ends, read = np.concatenate(dones, axis=1), partial(_joint, agents)
        timelines.append(Timeline(str(folder), ends, None, read, has_next=True))
    sources = tuple(
        PolicySource.parse({"label": folder.name, "name": "external"}, str(folder))
        for folder in folders
    )
    policies = sources if len(folders) > 1 else None
    prefixes = (*_REQUIRED_PREFIXES, *_STATE_PREFIXES)
    known = {f"{name}_{k}.npy" for k in range(len(shapes.actions)) for name in prefixes}
    unread = {path.name for folder in folders for path in folder.glob("*.npy")} - known
    return import_without_note(task, shapes, timelines, choices, policies, sorted(unread))


def _agents(folder: Path, n_agents: int) -> Agents:
    """Memory maps of every agent's arrays."""
    has_states = (folder / "states_0.npy").exists()
    names = (*_REQUIRED_PREFIXES, *(_STATE_PREFIXES if has_states else ()))
    agents = [
        {name: _map_array(folder / f"{name}_{k}.npy") for name in names} for k in range(n_agents)
    ]
    rows = {f"{name}_{k}": len(each[name]) for k, each in enumerate(agents) for name in names}
    check_lengths(rows, str(folder))
    return agents


def _map_array(path: Path) -> NDArray[Any]:
    """Maps an array of rows of numbers; ConversionError if the file is absent or something else."""
    if not path.is_file():
        raise ConversionError(f"{path} is missing, expected one for each obs_<i>.npy")
    with reading(path, "It is damaged, or not a NumPy file of numbers."):
        values = np.lib.format.open_memmap(path, mode="r")
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2):
        raise ConversionError(
            f"{path} has shape {values.shape} and dtype {values.dtype}, expected rows of numbers"
        )
    return np.asarray(values)


def _shapes(folder: Path, agents: Agents) -> AgentShapes:
    return AgentShapes(
        observations=tuple(columns_of(agent["obs"].shape) for agent in agents),
        actions=tuple(columns_of(agent["acs"].shape) for agent in agents),
        choices=tuple(
            count_choices(_two(agent["acs"]), str(folder / f"acs_{k}.npy"))
            for k, agent in enumerate(agents)
        ),
        states=columns_of(agents[0]["states"].shape) if "states" in agents[0] else 0,
    )


def _joint(agents: Agents, window: slice) -> dict[str, NDArray[Any]]:
    """Observations, actions and rewards of all agents, [n, N, columns], and the states."""
    found = {
        ours: pad_agents([_two(agent[name][window]) for agent in agents])
        for name, ours in _JOINT_ARRAYS.items()
    }
    if "states" in agents[0]:  # every agent has the same
        found |= {name: agents[0][name][window] for name in _STATE_PREFIXES}
    return found


def _two(values: NDArray[Any]) -> NDArray[Any]:
    return values.reshape(len(values), -1)


FORMAT = Format("numpy", "NumPy folders (OMAR, CFCQL)", KEPT_NAMES, LOST_REASONS, read, write)
