"""Reads NumPy folders that others wrote.

The source is one such folder, or a folder of several, such as `seed_0_data` to `seed_4_data`, which
become the policies of the dataset. `dones` is the only flag, so the user has to give the time
limit.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.foreign_data import import_without_note
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
from swarmdata.specs.recipe import PolicySource

REQUIRED_PREFIXES = ("obs", "acs", "rews", "next_obs", "dones")
STATE_PREFIXES = ("states", "next_states")
ALL_PREFIXES = (*REQUIRED_PREFIXES, *STATE_PREFIXES)

_JOINT_ARRAYS = {
    "obs": "observations",
    "next_obs": "next_observations",
    "acs": "actions",
    "rews": "rewards",
}

Agents = Sequence[Mapping[str, NDArray[Any]]]


def read_foreign(source: Path, task: str, choices: Choices) -> ImportedData:
    """Opens a folder, or a folder of folders in the order of their names.

    Raises:
        ConversionError: files are missing or do not fit together, or the ends are ambiguous.
    """
    folders = [source] if (source / "obs_0.npy").exists() else _inner(source)
    runs = {folder: _agents(folder) for folder in folders}
    kinds = {folder: _shapes(folder, agents) for folder, agents in runs.items()}
    shapes = kinds[folders[0]]
    if any(replace(each, choices=shapes.choices) != shapes for each in kinds.values()):
        raise ConversionError(f"the folders of {source} have different shapes: {kinds}")
    counts = share_choices([each for kind in kinds.values() for each in kind.choices])
    shapes = replace(shapes, choices=counts[: len(shapes.choices)])
    timelines = [_timeline(folder, agents) for folder, agents in runs.items()]
    sources = tuple(
        PolicySource.parse({"label": folder.name, "name": "external"}, str(folder))
        for folder in folders
    )
    policies = sources if len(folders) > 1 else None
    known = {f"{name}_{k}.npy" for k in range(len(shapes.actions)) for name in ALL_PREFIXES}
    unread = {path.name for folder in folders for path in folder.glob("*.npy")} - known
    return import_without_note(task, shapes, timelines, choices, policies, sorted(unread))


def _inner(source: Path) -> list[Path]:
    found = sorted(path.parent for path in source.glob("*/obs_0.npy"))
    if not found:
        raise ConversionError(
            f"{source} has neither obs_0.npy nor folders with it, expected for each agent i the "
            f"files {', '.join(f'{name}_<i>.npy' for name in REQUIRED_PREFIXES)}"
        )
    return sorted(found, key=lambda path: [int(k) for k in re.findall(r"\d+", path.name)])


def _agents(folder: Path) -> Agents:
    """Memory maps of every agent's arrays."""
    n_agents = len(list(folder.glob("obs_*.npy")))
    has_states = (folder / "states_0.npy").exists()
    names = ALL_PREFIXES if has_states else REQUIRED_PREFIXES
    agents = [
        {name: map_array(folder / f"{name}_{agent}.npy") for name in names}
        for agent in range(n_agents)
    ]
    rows = {
        f"{name}_{k}": len(values)
        for k, agent in enumerate(agents)
        for name, values in agent.items()
    }
    check_lengths(rows, str(folder))
    return agents


def map_array(path: Path) -> NDArray[Any]:
    """Maps an array of rows of numbers.

    Raises:
        ConversionError: there is no such file, or it holds something else.
    """
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


def _timeline(folder: Path, agents: Agents) -> Timeline:
    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        found = {
            ours: pad_agents([_two(agent[name][window]) for agent in agents])
            for name, ours in _JOINT_ARRAYS.items()
        }
        if "states" in agents[0]:  # every agent has the same
            found |= {name: agents[0][name][window] for name in STATE_PREFIXES}
        return found

    flags = [flags_of(each["dones"], 1, f"{folder}: dones_{k}") for k, each in enumerate(agents)]
    return Timeline(str(folder), np.concatenate(flags, axis=1), None, rows, has_next=True)


def _two(values: NDArray[Any]) -> NDArray[Any]:
    return values.reshape(len(values), -1)
