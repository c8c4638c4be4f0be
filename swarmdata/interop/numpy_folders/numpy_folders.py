"""Folders of NumPy arrays, one file per agent and quantity, as in OMAR and CFCQL.

Pan et al. 2022, "Plan Better Amid Conservatism" (OMAR), `utils/buffer.py`, and Shao et al. 2023,
"Counterfactual Conservative Q Learning" (CFCQL), `continuous/utils/buffer.py`: `obs_<i>.npy`,
`acs_<i>.npy`, `rews_<i>.npy`, `next_obs_<i>.npy`, `dones_<i>.npy` for each agent i, and with
MuJoCo also `states_<i>.npy` and `next_states_<i>.npy`, the same for every agent. One row per step,
without padding. `dones` marks the last step of every episode, also where a time limit ended it, as
in OMAR's particle data; `swarmdata.json` tells which it was.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.dataset_facts import (
    DATASET_FACTS,
    NEXT_PREFIX,
    Arrays,
    step_blocks,
)
from swarmdata.interop.conversion.export_note import ExportNote, note_of, parse_note
from swarmdata.interop.conversion.exported_data import import_with_note
from swarmdata.interop.conversion.foreign_rows import check_lengths, pad_agents
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.space_columns import recorded_agents
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.interop.numpy_folders.numpy_foreign import map_array, read_foreign
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.spaces import DiscreteSpace, MultiDiscreteSpace, width
from swarmdata.types import END_REASONS

NOTE_FILE = "swarmdata.json"

KEPT_NAMES = {
    "observations": "obs_<i>",
    "states": "states_<i>",
    "actions": "acs_<i>",
    "rewards": "rews_<i>",
    "terminations": "dones_<i>",
    "truncations": "dones_<i>",
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), NOTE_FILE),
}
LOST_REASONS = {
    name: "OMAR and CFCQL have no such files" for name in DATASET_FACTS if name not in KEPT_NAMES
}

_HORIZON = END_REASONS.index("horizon")


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
                    _write_header(files[name], values, n_rows)
                files[name].write(np.ascontiguousarray(values).tobytes())
    (path / NOTE_FILE).write_text(note_of(dataset, frame).to_json(), encoding="utf-8")


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


def _write_header(file: BinaryIO, values: NDArray[Any], n_rows: int) -> None:
    """Begins a file of `n_rows` rows like these, which are written one after another."""
    header = np.lib.format.header_data_from_array_1_0(values)
    shape = (n_rows, *values.shape[1:])
    np.lib.format.write_array_header_1_0(file, {**header, "fortran_order": False, "shape": shape})


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens a folder that this library wrote, one of others, or a folder of several.

    Raises:
        ConversionError: files are missing or do not fit together, or the ends are ambiguous.
    """
    note = source / NOTE_FILE
    if note.is_file():
        yield _read_exported(source, parse_note(note.read_bytes(), note))
    else:
        yield read_foreign(source, task, choices)


def _read_exported(source: Path, note: ExportNote) -> ImportedData:
    n_agents, names = len(note.spec.agent_names), ["obs", "next_obs", "acs", "rews"]
    agents = [
        {name: map_array(source / f"{name}_{k}.npy") for name in names} for k in range(n_agents)
    ]
    team = {"dones": map_array(source / "dones_0.npy")}
    if (source / "states_0.npy").exists():
        team |= {name: map_array(source / f"{name}_0.npy") for name in ("states", "next_states")}
    counts = {name: len(each) for name, each in team.items()}
    for k, arrays in enumerate(agents):
        counts |= {f"{name}_{k}": len(each) for name, each in arrays.items()}
    n_rows = check_lengths(counts, str(source))
    at_horizon = np.array(note.episodes.end_reason) == _HORIZON
    truncated = np.repeat(at_horizon, note.episodes.lengths)

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        done = team["dones"][window] != 0
        found = {
            "observations": pad_agents([agent["obs"][window] for agent in agents]),
            "next_observations": pad_agents([agent["next_obs"][window] for agent in agents]),
            "actions": pad_agents([agent["acs"][window] for agent in agents]).astype(np.float32),
            "rewards": np.stack([agent["rews"][window] for agent in agents], axis=1),
            "terminations": done & ~truncated[window],
            "truncations": done & truncated[window],
        }
        states = {name: team[name][window] for name in team if name != "dones"}
        return found | states

    return import_with_note(note, rows, n_rows, str(source))


FORMAT = Format("numpy", "NumPy folders (OMAR, CFCQL)", KEPT_NAMES, LOST_REASONS, read, write)
