"""Table: columns of a Parquet file as arrays, read by row groups."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError, MissingExtraError
from swarmdata.interop.conversion.block_reader import BlockReader
from swarmdata.interop.conversion.episode_cuts import ReadRows


def arrow() -> Any:
    """Returns the library pyarrow.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import pyarrow  # noqa: PLC0415  (an extra)
        import pyarrow.parquet  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("pyarrow", "parquet", "the Parquet format") from error
    return pyarrow


@dataclass(frozen=True, slots=True)
class Table:
    """A Parquet file of numbers and lists of numbers.

    Attributes:
        path: the file.
        columns: shape of a row of each column, by name; the same in all rows.
        n_rows: number of rows.
    """

    path: Path
    columns: Mapping[str, tuple[int, ...]]
    n_rows: int

    @classmethod
    def open(cls, path: Path) -> "Table":
        """Opens a file.

        Raises:
            ConversionError: it is not a Parquet file, or is empty.
        """
        file = _open(path)
        if not file.metadata.num_rows:
            raise ConversionError(f"{path} has no rows, expected at least 1")
        first = next(file.iter_batches(1))
        shapes = {name: _shape(first.column(name)[0].as_py()) for name in first.schema.names}
        return cls(path, shapes, file.metadata.num_rows)

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

        row_bytes = sum(4 * int(np.prod(self.columns[name])) for name in names)
        return BlockReader(read, self.n_rows, row_bytes)

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


def _open(path: Path) -> Any:
    library = arrow()
    try:
        return library.parquet.ParquetFile(path, memory_map=True)
    except (OSError, library.ArrowException) as error:
        raise ConversionError(f"{path} is not a Parquet file that can be read: {error}") from error
