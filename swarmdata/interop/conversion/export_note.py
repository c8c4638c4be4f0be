"""ExportNote: the identity, spec and episode table that travel with exported data.

It is stored as text in an attribute or file of the foreign format. An import then reads episode
boundaries, spaces, splits and policies instead of inferring them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reweighting import Relabeling, Reweighting
from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.conversion.dataset_facts import NEXT_PREFIX, STATE_ARRAYS, Arrays
from swarmdata.interop.conversion.episode_cuts import ReadRows, check_continues
from swarmdata.interop.conversion.foreign_rows import admit_exported
from swarmdata.interop.conversion.imported_data import ImportedData, build_episode
from swarmdata.runtime.documents import parse_json
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import AnySpec
from swarmdata.specs.origins.recording_origin import Id
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.recipe import PolicySource
from swarmdata.store import SPLITS
from swarmdata.types import END_REASONS, Counts, Episode, Float

Index = Annotated[int, Field(ge=0)]
Lengths = tuple[Annotated[int, Field(ge=1)], ...]


class EpisodeColumns(Frozen):
    """Columns over the episodes, in the order of their rows, all of the same length."""

    lengths: Lengths  # steps
    seeds: tuple[Annotated[int, Field(ge=0, lt=1 << 64)], ...]
    policy: tuple[Index, ...]  # into the policies
    split: tuple[Annotated[int, Field(ge=0, lt=len(SPLITS))], ...]
    end_reason: tuple[Annotated[int, Field(ge=0, lt=len(END_REASONS))], ...]

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        sizes = {name: len(values) for name, values in self if values is not None}
        if len(set(sizes.values())) != 1:
            raise ValueError(f"columns of different lengths: {sizes}")
        return self

    @property
    def assign_splits(self) -> Counts:
        """Split of each episode, uint8 [n]."""
        return np.array(self.split, dtype=np.uint8)


class ExportNote(Frozen):
    """What a foreign format has no field for."""

    swarmdata_note: Literal[1] = 1
    id: Id  # of the dataset that was exported
    digest: Sha256  # of that whole dataset; the export may be a view
    spec: AnySpec
    policies: Annotated[tuple[PolicySource, ...], Field(min_length=1)]
    episodes: EpisodeColumns
    frame: str = "world"  # of observations and actions, as `frames.find_frame` takes it


def note_of(dataset: Dataset, frame: str) -> ExportNote:
    """Returns the note to write beside an export of this view.

    Args:
        dataset: the view.
        frame: that its observations and actions were turned into; `world` if they were not.

    Raises:
        ConversionError: its rewards are those of a function, which no spec describes: an import
            would score its returns as those of the task.
    """
    table, spec = dataset.episodes, dataset.spec
    if isinstance(dataset.reweighting, Relabeling):
        raise ConversionError(
            f"{dataset!r} has rewards of a function, which an export cannot state. Export the "
            "dataset as it was recorded, and call the function on what is imported."
        )
    if isinstance(dataset.reweighting, Reweighting):  # the spec is that of the exported rewards
        spec = dataset.reweighting.applied_to(dataset.task)
    return ExportNote(
        id=dataset.id,
        digest=dataset.digest,
        spec=spec,
        policies=dataset.recipe.policies,
        episodes=EpisodeColumns(
            lengths=tuple(table.lengths.tolist()),
            seeds=tuple(table.seeds.tolist()),
            policy=tuple(table.policy.tolist()),
            split=tuple(table.split.tolist()),
            end_reason=tuple(table.end_reason.tolist()),
        ),
        frame=frame,
    )


def parse_note(text: str | bytes, source: Path | str) -> ExportNote:
    """Reads a note.

    Raises:
        ConversionError: the note is damaged, or of data in another frame than the world's.
    """
    try:
        note = ExportNote.parse(parse_json(text, str(source)), str(source))
    except SpecError as error:
        raise ConversionError(
            f"the note of swarmdata in {source} cannot be read: {error}. Export the dataset again."
        ) from error
    if note.frame != "world":
        raise ConversionError(
            f"{source} was exported in the frame {note.frame!r}, which cannot be turned back to "
            f"the recorded numbers. Load {note.id}, or export it without --frame."
        )
    return note


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
