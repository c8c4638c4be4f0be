"""Parts: immutable folders of consecutive episodes of one policy, written whole or not at all."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import DatasetError, MissingFileError, SchemaError, TruncatedFileError
from swarmdata.runtime.atomic import disk_full_explained, new_folder
from swarmdata.store.arrays.layout import ALL_FIELDS, OPTIONAL_FIELDS, TIME_FIELDS
from swarmdata.store.table import PART_COLUMNS, PartTable, measure
from swarmdata.types import Episode

_TABLE = "episodes.npy"
_LAYOUTS = "layouts.npy"
_CONSUMED = "consumed"


def write_part(folder: Path, episodes: Sequence[Episode]) -> None:
    """Writes consecutive episodes of one policy's stream as one part, in one rename.

    A part that exists is left as it is.

    Raises:
        SchemaError: no episodes, several policies, or arrays that do not fit together.
    """
    table = _table_of(folder, episodes)
    with new_folder(folder) as temporary:
        _save(temporary, table, episodes)


def write_scratch_part(folder: Path, episodes: Sequence[Episode]) -> None:
    """Writes a part for this process alone, which does not wait until it is on the disk.

    Raises:
        SchemaError: as `write_part`.
        DiskFullError: no space was left.
    """
    table = _table_of(folder, episodes)
    with disk_full_explained(folder, folder):
        folder.mkdir()
        _save(folder, table, episodes)


def _table_of(folder: Path, episodes: Sequence[Episode]) -> PartTable:
    """The table of a part, of episodes that fit together (SchemaError)."""
    if not episodes:
        raise SchemaError(f"part {folder} has no episodes, expected at least 1")
    policies = {episode.policy for episode in episodes}
    if len(policies) > 1:
        raise SchemaError(f"part {folder} mixes policies {sorted(policies)}, expected one")
    optional = {episode.optional for episode in episodes}
    if len(optional) > 1:
        raise SchemaError(f"part {folder} has episodes with {sorted(optional)}, expected one kind")
    return np.array([measure(episode) for episode in episodes], dtype=PART_COLUMNS)


def _save(folder: Path, table: PartTable, episodes: Sequence[Episode]) -> None:
    """Writes the files of a part."""
    layouts = [episode.layout[None] for episode in episodes]
    np.save(folder / _TABLE, table, allow_pickle=False)
    np.save(folder / _LAYOUTS, _join("layout", layouts, ("float32",)), allow_pickle=False)
    for name in (*TIME_FIELDS, *episodes[0].optional):
        values = [getattr(episode, name) for episode in episodes]
        joined = _join(name, values, ALL_FIELDS[name].dtypes)
        np.save(folder / f"{name}.npy", joined, allow_pickle=False)


def check_episode(episode: Episode) -> None:
    """Checks the values of one episode, as `write_part` checks those of several.

    Raises:
        SchemaError: an array has another dtype than its field, or values that are not finite.
    """
    for name in (*TIME_FIELDS, *episode.optional):
        _check(name, getattr(episode, name), ALL_FIELDS[name].dtypes)


def _check(name: str, values: NDArray[Any], dtypes: Sequence[str]) -> None:
    if str(values.dtype) not in dtypes:
        raise SchemaError(
            f"episode field {name!r} has dtype {values.dtype}, expected {' or '.join(dtypes)}"
        )
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise SchemaError(f"episode field {name!r} has values that are not finite")


def _join(name: str, values: Sequence[NDArray[Any]], dtypes: Sequence[str]) -> NDArray[Any]:
    """Concatenates over time, refusing to cast or to mix shapes."""
    kinds = {(value.dtype, value.shape[1:]) for value in values}
    if len(kinds) > 1:
        raise SchemaError(
            f"episode field {name!r} has (dtype, shape after the first axis) "
            f"{sorted((str(dtype), shape) for dtype, shape in kinds)}, expected one kind with "
            f"dtype {' or '.join(dtypes)}"
        )
    joined = np.concatenate(values)
    _check(name, joined, dtypes)
    return joined


def read_part_table(folder: Path) -> PartTable:
    """Reads what is needed to plan with a part: lengths, returns and counts, no trajectories.

    Raises:
        MissingFileError: there is no finished part.
        DatasetError: the table is damaged.
    """
    rows = _load(folder / _TABLE)
    if rows.dtype != PART_COLUMNS or rows.ndim != 1:
        raise DatasetError(f"{folder / _TABLE} has dtype {rows.dtype}, expected {PART_COLUMNS}")
    return rows


def optional_fields(folder: Path) -> tuple[str, ...]:
    """The optional arrays that a part has, sorted."""
    return tuple(name for name in sorted(OPTIONAL_FIELDS) if (folder / f"{name}.npy").exists())


def part_dtype(folder: Path, field: str) -> str:
    """The dtype of a field in a part."""
    return str(_load(folder / f"{field}.npy", mapped=True).dtype)


def read_part_layouts(folder: Path) -> NDArray[np.float32]:
    """Reads the obstacles of each episode of a part, [n, M, 8]."""
    layouts: NDArray[np.float32] = _load(folder / _LAYOUTS)
    return layouts


def is_consumed(folder: Path) -> bool:
    """Whether a dataset was being assembled that took the part's files: some are gone."""
    return (folder / _CONSUMED).exists()


def episode_slices(
    parts: Sequence[Path], field: str, *, consume: bool = False
) -> Iterator[NDArray[Any]]:
    """Yields one field of each episode of consecutive parts, holding one part open at a time.

    With `consume`, a part's file of the field is deleted once the next part is asked for.
    """
    extra = ALL_FIELDS[field].rows == "states"
    for folder in parts:
        ends = np.cumsum(read_part_table(folder)["length"] + extra)
        values = _load(folder / f"{field}.npy", mapped=True)
        if len(values) != ends[-1]:
            raise TruncatedFileError(
                f"{folder / field}.npy has {len(values)} rows, expected {ends[-1]}. {_hint(folder)}"
            )
        yield from np.split(values, ends[:-1])
        if consume:
            (folder / _CONSUMED).touch()
            del values  # the space is free when nothing maps the file
            (folder / f"{field}.npy").unlink()


def _load(path: Path, mapped: bool = False) -> NDArray[Any]:
    try:
        values = np.load(path, mmap_mode="r" if mapped else None, allow_pickle=False)
    except FileNotFoundError as error:
        raise MissingFileError(f"{path} is absent. {_hint(path.parent)}") from error
    except (ValueError, EOFError) as error:
        raise TruncatedFileError(f"{path} is damaged: {error}. {_hint(path.parent)}") from error
    return np.asarray(values)


def _hint(folder: Path) -> str:
    return f"Move the part {folder} away and run the same again; the other parts are kept."
