"""Parquet for Hugging Face `datasets`: one row per step, lists of fixed length, a file per split.

A folder with `data/<split>-00000-of-00001.parquet`, `episodes.parquet` and a README.md whose front
matter names them, so that `datasets.load_dataset(FOLDER)`, the Hub's viewer, DuckDB and pandas can
read it. Rows are in the order of episodes and steps, and columns have the names of our arrays. Each
row includes its next state, so rows may be shuffled. Such folders are read, as well as one file
with the columns observations, actions, rewards, terminations, truncations, and optionally
next_observations, states and next_states, as nested or flat lists.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
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
    STATE_ARRAYS,
    TIME_ARRAYS,
    row_shapes,
    step_blocks,
)
from swarmdata.interop.conversion.episode_cuts import Timeline
from swarmdata.interop.conversion.export_note import (
    ExportNote,
    import_with_note,
    note_of,
    parse_note,
)
from swarmdata.interop.conversion.foreign_data import import_without_note
from swarmdata.interop.conversion.foreign_rows import columns_of, flags_of, team_shapes
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.interop.parquet_rows import Table
from swarmdata.store import SPLITS
from swarmdata.types import Int

NOTE_FILE = "swarmdata.json"

KEPT_NAMES = {
    **{name: name for name in TIME_ARRAYS},
    **dict.fromkeys(("seed", "policy", "end_reason", "split", "spec"), NOTE_FILE),
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
    (path / NOTE_FILE).write_text(note_of(dataset, frame).to_json(), encoding="utf-8")
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
    fields = {name: _list_type(shape, dtype) for name, (shape, dtype) in shapes.items()}
    schema = library.schema({"episode": library.int64(), "step": library.int64(), **fields})
    lengths = dataset.episodes.lengths
    episodes = np.repeat(dataset.selection, lengths)
    steps = np.arange(len(episodes)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    with library.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for first, arrays in step_blocks(dataset):
            rows = slice(first, first + len(arrays["actions"]))
            columns = {name: _column(arrays[name]) for name in shapes}
            table = {"episode": episodes[rows], "step": steps[rows], **columns}
            writer.write_table(library.table(table, schema), row_group_size=_GROUP_ROWS)


def _list_type(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Any:
    library = arrow()
    kind = library.from_numpy_dtype(dtype)
    for size in reversed(shape):
        kind = library.list_(kind, size)
    return kind


def _column(values: NDArray[Any]) -> Any:
    library = arrow()
    column = library.array(np.ascontiguousarray(values).reshape(-1))
    for size in reversed(values.shape[1:]):
        column = library.FixedSizeListArray.from_arrays(column, size)
    return column


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens a folder that this library wrote, or one Parquet file of steps.

    Raises:
        ConversionError: it is neither, lacks columns, or is ambiguous.
    """
    note = source / NOTE_FILE
    if source.is_dir() and note.is_file():
        yield _read_exported(source, parse_note(note.read_bytes(), note))
    elif source.is_dir():
        files = sorted(source.rglob("*.parquet"))
        if len(files) != 1:
            raise ConversionError(
                f"{source} has no {NOTE_FILE} of an export, but {len(files)} Parquet files, "
                "expected one with all steps. Convert a single file."
            )
        yield read_foreign_file(files[0], task, choices)
    else:
        yield read_foreign_file(source, task, choices)


def _read_exported(source: Path, note: ExportNote) -> ImportedData:
    episodes = note.episodes
    codes, lengths = np.array(episodes.split), np.array(episodes.lengths)
    names = [*TIME_ARRAYS, *(NEXT_PREFIX + name for name in STATE_ARRAYS)]
    tables = {code: Table.open(source / _file(SPLITS[code]), names) for code in set(episodes.split)}
    readers = {code: table.reader(list(table.columns)) for code, table in tables.items()}
    starts = np.cumsum(lengths) - lengths
    inside = _starts_in_split(codes, lengths)

    def rows(window: slice) -> Mapping[str, NDArray[Any]]:
        episode = int(np.searchsorted(starts, window.start, "right")) - 1
        first = int(inside[episode])
        return readers[int(codes[episode])](slice(first, first + window.stop - window.start))

    return import_with_note(note, rows, sum(table.n_rows for table in tables.values()), str(source))


def _starts_in_split(codes: NDArray[Any], lengths: Int) -> Int:
    """First row of each episode in the file of its split."""
    starts = np.zeros(len(codes), dtype=np.int64)
    for code in np.unique(codes):
        chosen = codes == code
        starts[chosen] = np.cumsum(lengths[chosen]) - lengths[chosen]
    return starts


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


FORMAT = Format("parquet", "Parquet (Hugging Face datasets)", KEPT_NAMES, LOST_REASONS, read, write)
