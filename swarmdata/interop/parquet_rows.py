"""Table: columns of a Parquet file as arrays, read by row groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.hub.publishing.metadata.episode_parquet import arrow
from swarmdata.interop.conversion.episode_cuts import BlockReader, ReadRows
from swarmdata.interop.conversion.foreign_file import check_stored, reading


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
        """Opens the columns of a file that are wanted, where it has them.

        Raises:
            ConversionError: it is not a Parquet file, is empty, or a column is not of numbers.
        """
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

        def read(window: slice) -> Mapping[str, NDArray[Any]]:
            last_row = max(window.start, window.stop - 1)
            first, last = np.searchsorted(ends, [window.start, last_row], "right")
            table = file.read_row_groups(range(int(first), int(last) + 1), columns=names)
            skipped = int(ends[first] - sizes[first])
            part = table.slice(window.start - skipped, window.stop - window.start)
            return {name: self._array(name, part.column(name)) for name in names}

        return BlockReader(read, self.n_rows, self.row_bytes, self.path)

    def whole(self, name: str) -> NDArray[Any]:
        """All rows of one column."""
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
