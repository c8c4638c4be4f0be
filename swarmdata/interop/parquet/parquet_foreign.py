"""Reads a Parquet file of steps that this library did not write."""

from pathlib import Path

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.foreign_rows import columns_of, flags_of
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.team_columns import team_shapes
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.parquet.parquet_rows import Table

REQUIRED_COLUMNS = ("observations", "actions", "rewards", "terminations")
OPTIONAL_COLUMNS = ("next_observations", "states", "next_states", "truncations")
_FLAG_COLUMNS = ("terminations", "truncations")
_STATE_COLUMNS = {"states", "next_states"}


def read_foreign_file(path: Path, task: str, choices: Choices) -> ImportedData:
    """Imports a file with `REQUIRED_COLUMNS` and possibly `OPTIONAL_COLUMNS`.

    Raises:
        ConversionError: it is no such file, or is ambiguous.
    """
    table = Table.open(path, (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS))
    absent = [name for name in REQUIRED_COLUMNS if name not in table.columns]
    if absent:
        raise ConversionError(f"{path} has no columns {absent}, but {sorted(table.names)}")
    names = set(table.columns)
    if not names >= _STATE_COLUMNS:
        names -= _STATE_COLUMNS
    has_states = "states" in names
    n_states = columns_of((table.n_rows, *table.columns["states"])) if has_states else 0
    shape = (table.n_rows, *table.columns["observations"])
    shapes = team_shapes(shape, table.whole("actions"), choices, str(path), n_states)
    n_agents = len(shapes.observations)
    flags = {
        name: flags_of(table.whole(name), n_agents, f"{path}: {name}")
        for name in _FLAG_COLUMNS
        if name in names
    }
    timeline = Timeline(
        str(path),
        flags["terminations"],
        flags.get("truncations"),
        table.reader(sorted(names - set(flags))),
        "next_observations" in names,
    )
    unread = sorted(set(table.names) - names)
    return import_without_note(task, shapes, [timeline], choices, unread=unread)
