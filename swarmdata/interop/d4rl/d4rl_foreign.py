"""Reads D4RL-style HDF5 files that this library did not write."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.block_reader import BlockReader
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import check_lengths, flags_of
from swarmdata.interop.conversion.hdf5_reader import numbers
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.team_columns import team_shapes
from swarmdata.interop.conversion.user_choices import Choices

REQUIRED_KEYS = ("observations", "actions", "rewards", "terminals")
_OPTIONAL_KEYS = ("timeouts", "next_observations")
_FLAG_KEYS = ("terminals", "timeouts")


def read_foreign_file(file: Any, source: Path, task: str, choices: Choices) -> ImportedData:
    """Imports flat arrays: of one agent, of several concatenated agents, or with an agent axis.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    absent = [name for name in REQUIRED_KEYS if name not in file]
    if absent:
        raise ConversionError(
            f"{source} has no {absent[0]!r}, expected D4RL's keys observations, actions, rewards, "
            f"terminals and timeouts; it has {', '.join(sorted(file))}"
        )
    names = [name for name in (*REQUIRED_KEYS, *_OPTIONAL_KEYS) if name in file]
    arrays = {name: numbers(file, name, source) for name in names}
    n = check_lengths({name: len(each) for name, each in arrays.items()}, str(source))
    shapes = team_shapes(arrays["observations"].shape, arrays["actions"], choices, str(source))
    n_agents = len(shapes.observations)
    with reading(source):
        flags = {name: arrays[name][:] for name in _FLAG_KEYS if name in arrays}
    terminals, timeouts = (
        flags_of(flags[name], n_agents, f"{source}: {name}") if name in flags else None
        for name in _FLAG_KEYS
    )
    assert terminals is not None

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        return {name: each[window] for name, each in arrays.items() if name not in _FLAG_KEYS}

    row_bytes = sum(each.nbytes // n for each in arrays.values())
    reader = BlockReader(rows, n, row_bytes, source)
    timeline = Timeline(str(source), terminals, timeouts, reader, "next_observations" in arrays)
    unread = [name for name in _all_arrays(file) if name not in names]
    return import_without_note(task, shapes, [timeline], choices, unread=unread)


def _all_arrays(file: Any) -> list[str]:
    """Names of all arrays, those in groups with the group's."""
    found: list[str] = []
    file.visititems(lambda name, each: found.append(name) if hasattr(each, "dtype") else None)
    return found
