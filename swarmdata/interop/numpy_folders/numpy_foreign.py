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
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import stack_agents

REQUIRED_PREFIXES = ("obs", "acs", "rews", "next_obs", "dones")
STATE_PREFIXES = ("states", "next_states")

Agents = Sequence[Mapping[str, NDArray[Any]]]


def read_foreign(source: Path, task: str, choices: Choices) -> ImportedData:
    """Opens a folder, or a folder of folders in the order of their names.

    Raises:
        ConversionError: files are missing or do not fit together, or the ends are ambiguous.
    """
    folders = [source] if (source / "obs_0.npy").exists() else _inner(source)
    runs = {folder: _agents(folder) for folder in folders}
    kinds = {folder: _shapes(agents) for folder, agents in runs.items()}
    shapes = kinds[folders[0]]
    if any(replace(each, choices=shapes.choices) != shapes for each in kinds.values()):
        raise ConversionError(f"the folders of {source} have different shapes: {kinds}")
    shapes = replace(shapes, choices=max(each.choices for each in kinds.values()))
    timelines = [_timeline(folder, agents) for folder, agents in runs.items()]
    sources = tuple(
        PolicySource.parse({"label": folder.name, "name": "external"}, str(folder))
        for folder in folders
    )
    policies = sources if len(folders) > 1 else None
    return import_without_note(task, shapes, timelines, choices, policies)


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
    names = (*REQUIRED_PREFIXES, *STATE_PREFIXES) if has_states else REQUIRED_PREFIXES
    agents = [
        {name: map_array(folder / f"{name}_{agent}.npy") for name in names}
        for agent in range(n_agents)
    ]
    rows = {
        f"{name}_{k}": len(values)
        for k, agent in enumerate(agents)
        for name, values in agent.items()
    }
    if len(set(rows.values())) != 1:
        raise ConversionError(f"{folder} has arrays of different lengths: {rows}")
    return agents


def map_array(path: Path) -> NDArray[Any]:
    """Maps an array of rows of numbers.

    Raises:
        ConversionError: there is no such file, or it holds something else.
    """
    try:
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError as error:
        raise ConversionError(f"{path} is missing, expected one for each obs_<i>.npy") from error
    except (ValueError, EOFError) as error:
        raise ConversionError(f"{path} is not a NumPy file of numbers: {error}") from error
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2):
        raise ConversionError(
            f"{path} has shape {values.shape} and dtype {values.dtype}, expected rows of numbers"
        )
    return np.asarray(values)


def _shapes(agents: Agents) -> AgentShapes:
    is_discrete = all(agent["acs"].dtype.kind in "iu" for agent in agents)
    return AgentShapes(
        observations=tuple(_columns(agent["obs"]) for agent in agents),
        actions=tuple(_columns(agent["acs"]) for agent in agents),
        choices=max(int(agent["acs"].max()) for agent in agents) + 1 if is_discrete else 0,
        states=_columns(agents[0]["states"]) if "states" in agents[0] else 0,
    )


def _columns(values: NDArray[Any]) -> int:
    return 1 if values.ndim == 1 else int(values.shape[1])


def _timeline(folder: Path, agents: Agents) -> Timeline:
    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        def joint(name: str) -> NDArray[np.float32]:
            return stack_agents([_two(agent[name][window]) for agent in agents])

        found = {
            "observations": joint("obs"),
            "next_observations": joint("next_obs"),
            "actions": joint("acs"),
            "rewards": joint("rews")[..., 0],
        }
        if "states" in agents[0]:  # every agent has the same
            found["states"] = _two(agents[0]["states"][window]).astype(np.float32)
            found["next_states"] = _two(agents[0]["next_states"][window]).astype(np.float32)
        return found

    dones = np.stack([_two(agent["dones"])[:, 0] != 0 for agent in agents], axis=1)
    return Timeline(str(folder), dones, None, rows, has_next=True)


def _two(values: NDArray[Any]) -> NDArray[Any]:
    return values.reshape(len(values), -1)
