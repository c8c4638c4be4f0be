"""Data that this library exported: by its note, nothing has to be guessed."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.episode_cuts import Read, rows_equal
from swarmdata.interop.conversion.incoming import Incoming, episode_of
from swarmdata.interop.conversion.kept_facts import NEXT, STATE_ARRAYS, Arrays
from swarmdata.interop.conversion.note import Note
from swarmdata.types import Episode, Float


def noted(
    note: Note, read: Read, n_rows: int, source: str, layouts: Float | None = None
) -> Incoming:
    """Takes in data that this library exported, by its note.

    Args:
        note: of the export.
        read: gives the arrays of some rows by name, states with their `NEXT` twins.
        n_rows: that there are.
        source: for errors.
        layouts: of each episode, [n, M, 8], if they were kept.

    Raises:
        ConversionError: the rows are not those of the note; for flags, when an episode is taken.
    """
    table = note.episodes
    if sum(table.lengths) != n_rows:
        raise ConversionError(
            f"{source} has {n_rows} rows, its note of swarmdata says {sum(table.lengths)}. It was "
            "changed after the export: remove the note to convert it as foreign data."
        )

    def episodes() -> Iterator[Episode]:
        start = 0
        for k, length in enumerate(table.lengths):
            rows = joined_states(read(slice(start, start + length)), source, start)
            _check_end(rows, source, start)
            layout = None if layouts is None else layouts[k]
            yield episode_of(
                rows,
                seed=table.seeds[k],
                policy=table.policy[k],
                end=table.end_reason[k],
                layout=layout,
            )
            start += length

    metadata = {"exported_from": note.id, "exported_digest": note.digest}
    return Incoming(note.spec, note.policies, episodes(), table.split_codes, metadata)


def joined_states(rows: Arrays, source: str, start: int) -> dict[str, NDArray[Any]]:
    """Joins the arrays over states of one episode with their `NEXT` twins, T + 1 rows each.

    Raises:
        ConversionError: two rows do not continue each other.
    """
    n = len(rows["actions"])
    whole = {name: values for name, values in rows.items() if not name.startswith(NEXT)}
    for name in STATE_ARRAYS:
        if name not in rows:
            continue
        after = rows[NEXT + name]
        same = rows_equal(after[: n - 1], whole[name][1:n])
        if not same.all():
            row = start + int(np.argmin(same))
            raise ConversionError(
                f"{source}: {NEXT}{name} of row {row} differs from {name} of row {row + 1}, though "
                "both are of one episode: the rows were shuffled or changed after the export."
            )
        whole[name] = np.concatenate([whole[name][:n], after[n - 1 :]])
    return whole


def _check_end(rows: Arrays, source: str, start: int) -> None:
    ends = rows["terminations"] | rows["truncations"]
    both = rows["terminations"] & rows["truncations"]
    if ends[:-1].any() or not ends[-1] or both.any():
        raise ConversionError(
            f"{source}: the episode of rows {start} to {start + len(ends) - 1} does not end "
            "exactly once, in its last row: the rows were changed after the export."
        )
