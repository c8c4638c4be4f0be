"""Parquet for Hugging Face `datasets`: one row per step, lists of fixed length, a file per split.

A folder with `data/<split>-00000-of-00001.parquet`, `episodes.parquet` and a README.md whose front
matter names them, so that `datasets.load_dataset(FOLDER)`, the Hub's viewer, DuckDB and pandas can
read it. Rows are in the order of episodes and steps, and columns have the names of our arrays. Each
row includes its next state, so rows may be shuffled. Such folders are read, as well as one file
with the columns observations, actions, rewards, terminations, truncations, and optionally
next_observations, states and next_states, as nested or flat lists.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.hub.publishing.metadata.episode_parquet import (
    EPISODES_FILE,
    arrow,
    episode_table,
    parquet_bytes,
)
from swarmdata.interop.conversion.dataset_facts import (
    NEXT_PREFIX,
    NOTED_FACTS,
    TIME_ARRAYS,
    Arrays,
    row_shapes,
    step_blocks,
    time_keys,
)
from swarmdata.interop.conversion.export_note import (
    NOTE_FILE,
    ExportNote,
    import_with_note,
    read_note,
    write_note,
)
from swarmdata.interop.conversion.foreign_data import (
    BlockReader,
    ReadRows,
    Timeline,
    import_without_note,
)
from swarmdata.interop.conversion.foreign_file import check_stored, reading
from swarmdata.interop.conversion.foreign_rows import columns_of, flags_of, team_shapes
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.store import SPLITS

KEPT_NAMES = {
    **{name: name for name in TIME_ARRAYS},
    **dict.fromkeys(NOTED_FACTS, NOTE_FILE),
}
LOST_REASONS = {"layout": "it only has rows over time"}

_GROUP_ROWS = 8192


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as a folder of Parquet files."""
    (path / "data").mkdir(parents=True)
    names = [name for name in SPLITS if len(dataset.split(name))]  # type: ignore[arg-type]
    for name in names:
        _write_split(dataset.split(name), path / _file(name))  # type: ignore[arg-type]
    (path / EPISODES_FILE).write_bytes(parquet_bytes(episode_table(dataset)))
    write_note(dataset, path, frame)
    configs = [
        {
            "config_name": "steps",
            "default": True,
            "data_files": [{"split": name, "path": _file(name)} for name in names],
        },
        {"config_name": "episodes", "data_files": [{"split": "episodes", "path": EPISODES_FILE}]},
    ]
    front = yaml.safe_dump({"pretty_name": dataset.id, "configs": configs}, sort_keys=False)
    text = (
        f"---\n{front}---\n\n# {dataset.id}\n\nConverted by swarmdata; digest {dataset.digest}. "
        f"Observations and actions are in the frame `{frame}`.\n"
    )
    (path / "README.md").write_text(text, encoding="utf-8")


def _file(split: str) -> str:
    return f"data/{split}-00000-of-00001.parquet"


def _write_split(dataset: Dataset, path: Path) -> None:
    library = arrow()
    shapes = row_shapes(dataset)
    fields = {
        name: list_column(np.zeros((1, *shape), dtype)).type
        for name, (shape, dtype) in shapes.items()
    }
    schema = library.schema({"episode": library.int64(), "step": library.int64(), **fields})
    lengths = dataset.episodes.lengths
    episodes = np.repeat(dataset.selection, lengths)
    steps = np.arange(len(episodes)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    with library.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for first, arrays in step_blocks(dataset):
            rows = slice(first, first + len(arrays["actions"]))
            columns = {name: list_column(arrays[name]) for name in shapes}
            table = {"episode": episodes[rows], "step": steps[rows], **columns}
            writer.write_table(library.table(table, schema), row_group_size=_GROUP_ROWS)


def list_column(values: NDArray[Any]) -> Any:
    """Rows of numbers [n, ...] as nested lists of fixed length."""
    library = arrow()
    column = library.array(np.ascontiguousarray(values).reshape(-1))
    for size in reversed(values.shape[1:]):
        column = library.FixedSizeListArray.from_arrays(column, size)
    return column


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens a folder that this library wrote, or one Parquet file of steps."""
    if (note := read_note(source)) is not None:
        yield _read_exported(source, note)
        return
    files = sorted(source.rglob("*.parquet")) if source.is_dir() else [source]
    if len(files) != 1:
        raise ConversionError(
            f"{source} has no {NOTE_FILE} of an export, but {len(files)} Parquet files, "
            "expected one with all steps. Convert a single file."
        )
    yield read_foreign_file(files[0], task, choices)


def _read_exported(source: Path, note: ExportNote) -> ImportedData:
    episodes = note.episodes
    codes, lengths = np.array(episodes.split), np.array(episodes.lengths)
    names = [*time_keys(KEPT_NAMES, lambda name: NEXT_PREFIX + name)]
    tables = {code: Table.open(source / _file(SPLITS[code]), names) for code in set(episodes.split)}
    readers = {code: table.reader(list(table.columns)) for code, table in tables.items()}
    starts = np.cumsum(lengths) - lengths
    inside = np.zeros_like(starts)  # the first row of each episode in the file of its split
    for code in tables:
        own = lengths[codes == code]
        inside[codes == code] = np.cumsum(own) - own

    def rows(window: slice) -> Arrays:
        episode = int(np.searchsorted(starts, window.start, "right")) - 1
        first = int(inside[episode])
        return readers[int(codes[episode])](slice(first, first + window.stop - window.start))

    return import_with_note(note, rows, sum(table.n_rows for table in tables.values()), str(source))


_REQUIRED_COLUMNS = ("observations", "actions", "rewards", "terminations")
_OPTIONAL_COLUMNS = ("next_observations", "states", "next_states", "truncations")


def read_foreign_file(path: Path, task: str, choices: Choices) -> ImportedData:
    """Imports a file of steps."""
    table = Table.open(path, (*_REQUIRED_COLUMNS, *_OPTIONAL_COLUMNS))
    absent = [name for name in _REQUIRED_COLUMNS if name not in table.columns]
    if absent:
        raise ConversionError(f"{path} has no columns {absent}, but {sorted(table.names)}")
    names = set(table.columns)
    if not names >= {"states", "next_states"}:
        names -= {"states", "next_states"}
    has_states = "states" in names
    n_states = columns_of((table.n_rows, *table.columns["states"])) if has_states else 0
    shape = (table.n_rows, *table.columns["observations"])
    shapes = team_shapes(shape, table.whole("actions"), choices, str(path), n_states)
    n_agents = len(shapes.observations)
    flags = {
        name: flags_of(table.whole(name), n_agents, f"{path}: {name}")
        for name in ("terminations", "truncations")
        if name in names
    }
    terminals, truncations = flags["terminations"], flags.get("truncations")
    reader, has_next = table.reader(sorted(names - set(flags))), "next_observations" in names
    timeline = Timeline(str(path), terminals, truncations, reader, has_next)
    unread = sorted(set(table.names) - names)
    return import_without_note(task, shapes, [timeline], choices, unread=unread)


@dataclass(frozen=True, slots=True)
class Table:
    """A Parquet file of numbers and lists of numbers."""

    path: Path  # the file
    columns: Mapping[str, tuple[int, ...]]
    """Shape of a row of each column of numbers, by name; the same in all rows."""
    names: Sequence[str]  # all columns, others included
    n_rows: int  # number of rows

    @classmethod
    def open(cls, path: Path, wanted: Sequence[str]) -> "Table":
        """Opens the columns of a file that are wanted, where it has them; they hold numbers."""
        file = _open(path)
        if not file.metadata.num_rows:
            raise ConversionError(f"{path} has no rows, expected at least 1")
        schema = file.schema_arrow
        names = [name for name in wanted if name in schema.names]
        for name in names:
            _check_numbers(schema.field(name).type, f"{path}: column {name!r}")
        with reading(path):
            first = next(file.iter_batches(1, columns=names))
            shapes = {name: _shape(first.column(name)[0].as_py()) for name in names}
        table = cls(path, shapes, schema.names, file.metadata.num_rows)
        check_stored(path, table.n_rows * table.row_bytes, path.stat().st_size)
        return table

    @property
    def row_bytes(self) -> int:
        """Bytes of a row in memory, about."""
        return sum(4 * int(np.prod(shape)) for shape in self.columns.values())

    def reader(self, names: list[str]) -> ReadRows:
        """Returns a reader of windows of rows of some columns, [n, *shape]."""
        file = _open(self.path)
        sizes = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
        ends = np.cumsum(sizes)

        def read(window: slice) -> Arrays:
            last_row = max(window.start, window.stop - 1)
            first, last = np.searchsorted(ends, [window.start, last_row], "right")
            table = file.read_row_groups(range(int(first), int(last) + 1), columns=names)
            skipped = int(ends[first] - sizes[first])
            part = table.slice(window.start - skipped, window.stop - window.start)
            return {name: self._array(name, part.column(name)) for name in names}

        return BlockReader(read, self.n_rows, self.row_bytes, self.path)

    def whole(self, name: str) -> NDArray[Any]:
        return np.asarray(self.reader([name])(slice(0, self.n_rows))[name])

    def _array(self, name: str, column: Any) -> NDArray[Any]:
        n, shape = len(column), self.columns[name]
        column = column.combine_chunks()
        nulls = column.null_count
        while arrow().types.is_nested(column.type):
            column = column.flatten()
            nulls += column.null_count
        values = column.to_numpy(zero_copy_only=False)
        if len(values) != n * int(np.prod(shape)) or nulls:
            raise ConversionError(
                f"{self.path}: column {name!r} has rows of different lengths or nulls, expected "
                f"rows of shape {shape} as the first one"
            )
        return np.asarray(values).reshape(n, *shape)


def _shape(value: Any) -> tuple[int, ...]:
    """Shape of nested lists; () for a single value."""
    sizes = []
    while isinstance(value, list):
        sizes.append(len(value))
        value = value[0] if value else None
    return tuple(sizes)


def _check_numbers(kind: Any, where: str) -> None:
    """Raises ConversionError unless a type is that of numbers, or of lists of them."""
    types, inner = arrow().types, kind
    while types.is_list(inner) or types.is_large_list(inner) or types.is_fixed_size_list(inner):
        inner = inner.value_type
    if not (types.is_integer(inner) or types.is_floating(inner) or types.is_boolean(inner)):
        raise ConversionError(
            f"{where} is of type {kind}, expected numbers or lists of numbers. Convert the column "
            "before, or leave it out."
        )


def _open(path: Path) -> Any:
    library = arrow()
    with reading(path, "It is damaged, or not a Parquet file."):
        return library.parquet.ParquetFile(path, memory_map=True)


FORMAT = Format("parquet", "Parquet (Hugging Face datasets)", KEPT_NAMES, LOST_REASONS, read, write)
