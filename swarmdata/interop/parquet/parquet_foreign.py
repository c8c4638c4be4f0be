"""Reads a Parquet file of steps that this library did not write."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.episode_cuts import ReadRows, Timeline
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.imported_data import AgentShapes, ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.parquet.parquet_rows import Table

REQUIRED_COLUMNS = ("observations", "actions", "rewards", "terminations")
OPTIONAL_COLUMNS = ("next_observations", "states", "next_states", "truncations")
_FLAG_COLUMNS = ("terminations", "truncations")
_AGENT_COLUMNS = ("observations", "next_observations", "actions")


def read_foreign_file(path: Path, task: str, choices: Choices) -> ImportedData:
    """Imports a file with `REQUIRED_COLUMNS` and possibly `OPTIONAL_COLUMNS`.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    table = Table.open(path)
    absent = [name for name in REQUIRED_COLUMNS if name not in table.columns]
    if absent:
        raise ConversionError(f"{path} has no columns {absent}, but {sorted(table.columns)}")
    names = [name for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS) if name in table.columns]
    shape = table.columns["observations"]
    n_agents = shape[0] if len(shape) > 1 else choices.n_agents or 1
    sizes = {name: int(np.prod(table.columns[name])) for name in ("observations", "actions")}
    wrong = {name: size for name, size in sizes.items() if size % n_agents}
    if wrong:
        raise ConversionError(f"{path} has rows of sizes {wrong} for {n_agents} agents")
    flags = {name: _flags(table, name, n_agents) for name in _FLAG_COLUMNS if name in names}
    reader = _like_ours(table, [name for name in names if name not in flags], n_agents)
    actions = table.whole("actions")
    has_states = {"states", "next_states"} <= set(names)
    shapes = AgentShapes(
        observations=(sizes["observations"] // n_agents,) * n_agents,
        actions=(sizes["actions"] // n_agents,) * n_agents,
        choices=int(actions.max()) + 1 if actions.dtype.kind in "iu" else 0,
        states=int(np.prod(table.columns["states"])) if has_states else 0,
    )
    has_next = "next_observations" in names
    ends, cuts = flags["terminations"], flags.get("truncations")
    return import_without_note(
        task, shapes, [Timeline(str(path), ends, cuts, reader, has_next)], choices
    )


def _like_ours(table: Table, names: list[str], n_agents: int) -> ReadRows:
    read = table.reader(names)

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        found = {}
        for name, values in read(window).items():
            n = len(values)
            flat: NDArray[Any] = values.reshape(n, -1).astype(np.float32)
            if name in _AGENT_COLUMNS:
                flat = flat.reshape(n, n_agents, -1)
            elif name == "rewards":  # the team's, or one for each agent
                flat = np.broadcast_to(flat, (n, n_agents)).copy()
            found[name] = flat
        return found

    return rows


def _flags(table: Table, name: str, n_agents: int) -> NDArray[np.bool_]:
    values = table.whole(name).reshape(table.n_rows, -1) != 0
    return np.broadcast_to(values, (table.n_rows, n_agents)).copy()
