"""One Parquet file of steps that this library did not write."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.episode_cuts import Read, Timeline
from swarmdata.interop.conversion.foreign_data import unnoted
from swarmdata.interop.conversion.incoming import Incoming, Shapes
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.parquet.parquet_rows import Table

NEEDED = ("observations", "actions", "rewards", "terminations")
OPTIONAL = ("next_observations", "states", "next_states", "truncations")
_FLAGS = ("terminations", "truncations")
_OF_AGENTS = ("observations", "next_observations", "actions")


def unnoted_file(path: Path, task: str, choices: Choices) -> Incoming:
    """Takes in a file with the columns `NEEDED` and maybe `OPTIONAL`.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    table = Table.open(path)
    absent = [name for name in NEEDED if name not in table.columns]
    if absent:
        raise ConversionError(f"{path} has no columns {absent}, but {sorted(table.columns)}")
    names = [name for name in (*NEEDED, *OPTIONAL) if name in table.columns]
    seen = table.columns["observations"]
    n_agents = seen[0] if len(seen) > 1 else choices.n_agents or 1
    sizes = {name: int(np.prod(table.columns[name])) for name in ("observations", "actions")}
    wrong = {name: size for name, size in sizes.items() if size % n_agents}
    if wrong:
        raise ConversionError(f"{path} has rows of sizes {wrong} for {n_agents} agents")
    flags = {name: _flags(table, name, n_agents) for name in _FLAGS if name in names}
    reader = _like_ours(table, [name for name in names if name not in flags], n_agents)
    has_states = {"states", "next_states"} <= set(names)
    shapes = Shapes(
        observations=(sizes["observations"] // n_agents,) * n_agents,
        actions=(sizes["actions"] // n_agents,) * n_agents,
        choices=_n_choices(table),
        states=int(np.prod(table.columns["states"])) if has_states else 0,
    )
    has_next = "next_observations" in names
    ends, cuts = flags["terminations"], flags.get("truncations")
    return unnoted(task, shapes, [Timeline(str(path), ends, cuts, reader, has_next)], choices)


def _like_ours(table: Table, names: list[str], n_agents: int) -> Read:
    read = table.reader(names)

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        found = {}
        for name, values in read(window).items():
            n = len(values)
            flat: NDArray[Any] = values.reshape(n, -1).astype(np.float32)
            if name in _OF_AGENTS:
                flat = flat.reshape(n, n_agents, -1)
            elif name == "rewards":  # one for all, or one each
                flat = np.broadcast_to(flat, (n, n_agents)).copy()
            found[name] = flat
        return found

    return rows


def _flags(table: Table, name: str, n_agents: int) -> NDArray[np.bool_]:
    values = table.whole(name).reshape(table.n_rows, -1) != 0
    return np.broadcast_to(values, (table.n_rows, n_agents)).copy()


def _n_choices(table: Table) -> int:
    """How many values discrete actions have, 0 for continuous ones."""
    actions = table.whole("actions")
    return int(actions.max()) + 1 if actions.dtype.kind in "iu" else 0
