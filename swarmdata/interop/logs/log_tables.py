"""LogTable: named columns of one table or topic, and the readers of CSV and Parquet files."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError, did_you_mean, listed
from swarmdata.hub.publishing.metadata.episode_parquet import arrow
from swarmdata.interop.conversion.foreign_file import ForeignFile
from swarmdata.specs.origins.log_map import TableForm, WindowRows
from swarmdata.specs.plain_names import repeated
from swarmdata.types import Bool, Int

PARQUET_SUFFIXES = (".parquet", ".pq")

NANOSECONDS_IN = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # nanoseconds in each unit of time
MOST_NANOSECONDS = 1 << 62  # greatest absolute value of a time, 146 years


Cells = Sequence[str] | NDArray[Any]
"""Texts of a column, or numbers, [n] or [n, B]; arrays of several lengths are objects, [n]."""


@dataclass(frozen=True, slots=True, eq=False)
class LogTable:
    """Rows of a table, or messages of a topic; ConversionError if a column is not as wanted."""

    name: str  # file or topic, for errors
    cells: Mapping[str, Cells]  # of each column, by name
    units: Mapping[str, str] = field(default_factory=dict)  # of columns whose format fixes them
    frame: str = ""  # of what it holds, if its messages say so
    used: set[str] = field(default_factory=set)  # columns that were read

    def _column(self, name: str) -> Cells:
        if name not in self.cells:
            raise ConversionError(
                f"{self.name} has no column {name!r}.{did_you_mean(name, self.cells)} "
                f"It has {listed(name, self.cells)}."
            )
        self.used.add(name)
        return self.cells[name]

    def numbers(self, name: str) -> NDArray[Any]:
        """A column of numbers, int64, float64 or flags, [n] or [n, B]; empty cells are NaN."""
        cells = self._column(name)
        if not isinstance(cells, np.ndarray):
            texts = enumerate(cells, 1)
            found = [_number(text, f"{self.name}, row {k}, {name}") for k, text in texts]
            return np.array(found, np.float64)
        if cells.dtype == object:
            sizes = [len(row) for row in cells]
            raise ConversionError(
                f"{self.name}: column {name!r} has rows of {min(sizes)} to {max(sizes)} numbers, "
                "expected the same number in all"
            )
        if cells.dtype.kind not in "biuf":
            raise ConversionError(f"{self.name}: column {name!r} has no numbers")
        if cells.dtype.kind in "iu" and (cells <= np.iinfo(np.int64).max).all():
            return cells.astype(np.int64)
        return cells if cells.dtype.kind == "b" else cells.astype(np.float64)

    def arrays(self, name: str) -> list[NDArray[Any]]:
        """A column of numbers as one float64 array for each row, of one or several lengths."""
        cells = self._column(name)
        if isinstance(cells, np.ndarray) and cells.dtype == object:
            return [row.astype(np.float64) for row in cells]
        values = self.numbers(name).astype(np.float64)
        return list(values.reshape(len(values), -1))

    def nanoseconds(self, name: str, unit: str) -> Int:
        """A column of times in a unit, as whole nanoseconds, exact unless it is floats, [n]."""
        size, cells = NANOSECONDS_IN[unit], self._column(name)
        where = f"{self.name}: times in column {name!r}"
        if not isinstance(cells, np.ndarray):
            return np.array([_exact(text, size, where) for text in cells], np.int64)
        if cells.ndim != 1 or cells.dtype.kind not in "iuf":
            raise ConversionError(f"{where} are not numbers, expected one in each row")
        if not (np.abs(cells.astype(np.float64)) * size <= MOST_NANOSECONDS).all():  # nor is NaN
            raise ConversionError(f"{where} are missing, or out of bounds")
        if cells.dtype.kind in "iu":
            return cells.astype(np.int64) * size
        return np.round(cells * size).astype(np.int64)

    def texts(self, name: str) -> list[str]:
        """A column as text, [n]."""
        return [str(cell) for cell in self._column(name)]

    def rows_with(self, name: str, value: str | int, *, may_lack: bool = False) -> Bool:
        """Which rows have a value in a column, [n]; refused if none has, unless `may_lack`."""
        cells = self.texts(name)
        same = {text: _is_same(text, value) for text in dict.fromkeys(cells)}
        if not may_lack and not any(same.values()):
            raise ConversionError(
                f"{self.name}: no row has {value!r} in column {name!r}, which has "
                f"{listed(str(value), same)}"
            )
        return np.array([same[text] for text in cells], np.bool_)

    def matching(self, pattern: str) -> list[str]:
        """Columns whose names match a pattern with `*`, in their order."""
        return [name for name in self.cells if is_match(name, [pattern])]

    @property
    def n_rows(self) -> int:
        return len(next(iter(self.cells.values())))

    def unused(self, ignored: Sequence[str]) -> list[str]:
        """Columns that neither were read nor match an ignored name."""
        rest = [name for name in self.cells if name not in self.used]
        return [name for name in rest if not is_match(name, ignored)]


def is_match(name: str, patterns: Sequence[str]) -> bool:
    """Whether a name is one of these, or matches one of them, where `*` stands for any text."""
    return any(
        re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name) for pattern in patterns
    )


def _plain(text: str) -> str:
    """The text of a number as every program writes it: Python also takes `1_0` and other digits."""
    if "_" in text or not text.isascii():
        raise ValueError("expected digits from 0 to 9")
    return text.strip()


def _exact(text: str, size: int, where: str) -> int:
    try:
        found = round(Decimal(_plain(text)) * size)
    except (ArithmeticError, ValueError) as error:  # of no number, and of an infinite one
        raise ConversionError(f"{where} have {text!r:.80}, expected a number") from error
    if abs(found) > MOST_NANOSECONDS:
        raise ConversionError(f"{where} have {text!r:.80}, which is out of bounds")
    return found


def _number(text: str, where: str) -> float:
    try:
        return float(_plain(text)) if text.strip() else float("nan")
    except ValueError as error:
        raise ConversionError(f"{where} is {text!r:.80}, expected a number") from error


def _is_same(text: str, value: str | int) -> bool:
    try:
        return float(text) == float(value)
    except ValueError:
        return text.strip() == str(value)


def read_table(path: Path, forms: Mapping[str, TableForm]) -> LogTable:
    """Reads a Parquet file, or a text table as the form for its name says."""
    if path.suffix in PARQUET_SUFFIXES:
        cells, units = _parquet_columns(path)
        table = LogTable(path.name, cells, units)
    else:
        named = (form for name, form in forms.items() if is_match(path.name, [name]))
        form = next(named, TableForm())
        table = LogTable(path.name, _text_columns(path, form))
        if form.windows is not None:
            table = _unrolled(table, form.windows)
    if not table.cells or not table.n_rows:
        raise ConversionError(f"{path} has no rows, expected at least 1")
    return table


def _unrolled(table: LogTable, windows: WindowRows) -> LogTable:
    """A table with a row for each step of each window, and a column `time`."""
    pattern = re.escape(windows.columns).replace(r"\{step\}", r"(?P<step>[0-9]+)")
    steps: dict[str, dict[int, list[str]]] = {}
    for name in table.cells:
        match = re.fullmatch(pattern.replace(r"\{column\}", "(?P<column>.+)"), name)
        if match is None or match["column"] == "time":
            raise ConversionError(
                f"{table.name} has a column {name!r}, expected columns of windows that are named "
                f"{windows.columns}, none of them `time`"
            )
        steps.setdefault(match["column"], {})[int(match["step"])] = table.texts(name)
    first = next(iter(steps.values()))
    numbers = list(range(min(first), min(first) + len(first)))
    for column, numbered in steps.items():
        if sorted(numbered) != numbers:
            raise ConversionError(
                f"{table.name}: column {column!r} has {len(numbered)} steps from {min(numbered)} "
                f"to {max(numbered)}, expected {numbers[0]} to {numbers[-1]} like the first column"
            )
    step, pause = (round(each * NANOSECONDS_IN["s"]) for each in (windows.step, windows.pause))
    starts = np.arange(table.n_rows) * (step * (len(numbers) - 1) + pause)
    times: NDArray[Any] = (starts[:, None] + step * np.arange(len(numbers))).ravel()
    rows = range(table.n_rows)
    found: dict[str, Cells] = {"time": times}
    for column, numbered in steps.items():
        found[column] = [numbered[number][row] for row in rows for number in numbers]
    return LogTable(table.name, found, {"time": "ns"})


def _text_columns(path: Path, form: TableForm) -> dict[str, list[str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(_rows(file, form))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConversionError(f"{path} is not a text table: {error}") from error
    header = list(form.header or (rows.pop(0)[1] if rows else ()))
    if "" in header:
        raise ConversionError(
            f"{path} has no name for column {header.index('') + 1}, perhaps the row numbers of "
            "pandas: write it with `index=False`, or name all columns in `tables` of the map"
        )
    if len(set(header)) < len(header):
        raise ConversionError(f"{path} has several columns of one name: {header}")
    for line, cells in rows:
        if len(cells) != len(header):
            raise ConversionError(
                f"{path}, line {line} has {len(cells)} cells, expected {len(header)}: "
                f"{', '.join(header)}. `tables` of the map has the delimiter, the header and the "
                "mark of comments."
            )
    return {name: [cells[k] for _, cells in rows] for k, name in enumerate(header)}


def _rows(file: Any, form: TableForm) -> Iterator[tuple[int, list[str]]]:
    """The cells of each line that is neither empty nor a comment, with its number."""

    def lines() -> Iterator[str]:
        for line in file:
            is_comment = form.comment and line.lstrip().startswith(form.comment)
            yield "\n" if is_comment or not line.strip() else line

    if form.delimiter == "whitespace":
        split: Iterator[list[str]] = (line.split() for line in lines())
    else:
        reader = csv.reader(lines(), delimiter=form.delimiter)
        split = ([cell.strip() for cell in cells] for cells in reader)
    yield from ((number, cells) for number, cells in enumerate(split, 1) if cells)


def _parquet_columns(path: Path) -> tuple[dict[str, Cells], dict[str, str]]:
    """The columns by name, and the units of those that are times."""
    library, source = arrow(), ForeignFile(path)
    with source.call():
        file = library.parquet.ParquetFile(path, page_checksum_verification=True)
        groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
        sizes = [each.column(k).num_values for each in groups for k in range(each.num_columns)]
    source.take(8 * sum(sizes))
    with source.call():
        table = file.read()
    if twice := repeated(table.column_names):
        raise ConversionError(f"{path} has several columns of one name: {', '.join(twice)}")
    found: dict[str, Cells] = {}
    units = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        source.place = f"column {name!r}"
        found[name] = _parquet_cells(library, source, column)
        if library.types.is_timestamp(column.type) or library.types.is_duration(column.type):
            units[name] = "ns"
    return found, units


def _parquet_cells(library: Any, source: ForeignFile, column: Any) -> Cells:
    kind, types = column.type, library.types
    is_list = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    inner = kind.value_type if is_list else kind
    is_number = types.is_floating(inner) or types.is_integer(inner)
    with source.call():
        if types.is_timestamp(kind):
            column = column.cast(library.timestamp("ns", kind.tz)).cast(library.int64())
        elif types.is_duration(kind):
            column = column.cast(library.duration("ns")).cast(library.int64())
        elif types.is_decimal(kind):
            column = column.cast(library.float64())
        elif is_list or not is_number:
            column = column.to_pylist()
        if not isinstance(column, list):
            return np.asarray(column.to_numpy())
    if is_list and is_number:
        return stacked([np.array([] if row is None else row, np.float64) for row in column])
    return ["" if cell is None else str(cell) for cell in column]


def stacked(rows: list[NDArray[Any]]) -> Cells:
    """Arrays as one, [n, B], or as objects if their lengths differ."""
    if len({len(row) for row in rows}) == 1:
        return np.array(rows)
    found = np.empty(len(rows), object)
    for k, row in enumerate(rows):
        found[k] = row
    return found
