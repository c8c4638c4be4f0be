"""Imports data that this library exported: its note leaves nothing to guess."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import NEXT_PREFIX, STATE_ARRAYS, Arrays
from swarmdata.interop.conversion.episode_cuts import ReadRows, check_continues
from swarmdata.interop.conversion.export_note import ExportNote
from swarmdata.interop.conversion.foreign_rows import admit_exported
from swarmdata.interop.conversion.imported_data import ImportedData, build_episode
from swarmdata.types import Episode, Float


def import_with_note(
    note: ExportNote, read: ReadRows, n_rows: int, source: str, layouts: Float | None = None
) -> ImportedData:
    """Imports data that this library exported.

    Args:
        note: note of the export.
        read: reads arrays by name, for states also those after each step (`NEXT_PREFIX`).
        n_rows: number of rows.
        source: name for errors.
        layouts: obstacles of each episode, [n, M, 8], if they were kept.

    Raises:
        ConversionError: the rows do not fit the note; flags are checked when an episode is taken.
    """
    table = note.episodes
    if sum(table.lengths) != n_rows:
        raise ConversionError(
            f"{source} has {n_rows} rows, but its note of swarmdata says {sum(table.lengths)}. It "
            "was changed after the export: remove the note to convert it as foreign data."
        )

    if layouts is not None and len(layouts) != len(table.lengths):
        raise ConversionError(
            f"{source} has {len(layouts)} layouts, but its note of swarmdata says "
            f"{len(table.lengths)} episodes. It was changed after the export."
        )

    def episodes() -> Iterator[Episode]:
        start = 0
        for k, length in enumerate(table.lengths):
            found = read(slice(start, start + length))
            admit_exported(found, length, f"{source}, rows {start} to {start + length - 1}")
            rows = join_states(found, source, start)
            _check_end(rows, source, start)
            layout = None if layouts is None else layouts[k]
            yield build_episode(
                rows,
                seed=table.seeds[k],
                policy=table.policy[k],
                end=table.end_reason[k],
                layout=layout,
            )
            start += length

    metadata = {"exported_from": note.id, "exported_digest": note.digest}
    return ImportedData(note.spec, note.policies, episodes(), table.assign_splits, metadata)


def join_states(rows: Arrays, source: str, start: int) -> dict[str, NDArray[Any]]:
    """Joins states before and after each step of one episode, to T + 1 rows.

    Raises:
        ConversionError: a state after a step differs from the state before the next one.
    """
    whole = {name: values for name, values in rows.items() if not name.startswith(NEXT_PREFIX)}
    for name in STATE_ARRAYS:
        if name not in rows:
            continue
        after = rows[NEXT_PREFIX + name]
        advice = "The rows were shuffled or changed after the export."
        check_continues(name, whole[name], after, source, start, advice)
        whole[name] = np.concatenate([whole[name], after[-1:]])
    return whole


def _check_end(rows: Arrays, source: str, start: int) -> None:
    ends = rows["terminations"] | rows["truncations"]
    both = rows["terminations"] & rows["truncations"]
    if ends[:-1].any() or not ends[-1] or both.any():
        raise ConversionError(
            f"{source}: the episode of rows {start} to {start + len(ends) - 1} does not end "
            "exactly once, in its last row: the rows were changed after the export."
        )
