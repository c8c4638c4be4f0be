"""ExportNote: the identity, spec and episode table that travel with exported data.

An import reads episode boundaries, spaces, splits and policies from it instead of inferring them.
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
from swarmdata.interop.conversion.dataset_facts import Arrays
from swarmdata.interop.conversion.foreign_data import ReadRows, join_states
from swarmdata.interop.conversion.foreign_rows import admit_exported
from swarmdata.interop.conversion.imported_data import ImportedData, build_episode
from swarmdata.runtime.documents import parse_json
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import AnySpec, SideSpec
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.recipe import Id, PolicySource
from swarmdata.store import SPLITS
from swarmdata.types import END_REASONS, Bool, Episode, Float

NOTE_FILE = "swarmdata.json"

MAX_NOTE_BYTES = 1 << 26  # a million episodes take half of it

Index = Annotated[int, Field(ge=0)]
Lengths = tuple[Annotated[int, Field(ge=1)], ...]


class EpisodeColumns(Frozen):
    """Columns over the episodes, in the order of their rows, all of the same length."""

    lengths: Lengths  # steps
    seeds: tuple[Annotated[int, Field(ge=0, lt=1 << 64)], ...]
    policy: tuple[Index, ...]  # into the policies
    split: tuple[Annotated[int, Field(ge=0, lt=len(SPLITS))], ...]
    end_reason: tuple[Annotated[int, Field(ge=0, lt=len(END_REASONS))], ...]
    truncated: tuple[bool, ...] = ()
    """Of no episode in earlier notes: those were truncated that ended at the horizon."""

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        sizes = {name: len(values) for name, values in self if values or name != "truncated"}
        if len(set(sizes.values())) != 1:
            raise ValueError(f"columns of different lengths: {sizes}")
        return self


class ExportNote(Frozen):
    """What a foreign format has no field for."""

    swarmdata_note: Literal[1] = 1
    id: Id  # of the dataset that was exported
    digest: Sha256  # of that whole dataset; the export may be a view
    spec: AnySpec
    policies: Annotated[tuple[PolicySource, ...], Field(min_length=1)]
    episodes: EpisodeColumns
    frame: str = "world"  # of observations and actions, as `frames.find_frame` takes it

    @property
    def truncated(self) -> Bool:
        """Which episodes were truncated, [n]."""
        if self.episodes.truncated:
            return np.array(self.episodes.truncated)
        return np.array(self.episodes.end_reason) == END_REASONS.index("horizon")

    def imported(self, episodes: Iterator[Episode]) -> ImportedData:
        """What an import of the export gives, whose splits are known."""
        splits = np.array(self.episodes.split, dtype=np.uint8)
        metadata = {"exported_from": self.id, "exported_digest": self.digest}
        return ImportedData(self.spec, self.policies, episodes, splits, metadata)

    def episode(self, k: int, rows: Arrays, layout: Float | None) -> Episode:
        """Episode k, of its arrays."""
        seed, policy = self.episodes.seeds[k], self.episodes.policy[k]
        end = self.episodes.end_reason[k]
        return build_episode(rows, seed=seed, policy=policy, end=end, layout=layout)


def note_of(dataset: Dataset, frame: str) -> ExportNote:
    """The note of an export of a view, whose observations and actions are in a frame.

    Raises:
        ConversionError: its rewards are those of a function, which no spec describes.
    """
    table, spec = dataset.episodes, dataset.spec
    if isinstance(dataset.reweighting, Relabeling):
        raise ConversionError(
            f"{dataset!r} has rewards of a function, which an export cannot state. Export the "
            "dataset as it was recorded, and call the function on what is imported."
        )
    if isinstance(dataset.reweighting, Reweighting):  # the spec is that of the exported rewards
        spec = dataset.reweighting.applied_to(dataset.task)
    kept = EpisodeColumns.model_fields.keys() - {"truncated"}
    truncations = dataset.stored.arrays["truncations"]
    return ExportNote(
        id=dataset.id,
        digest=dataset.digest,
        spec=spec,
        policies=dataset.recipe.policies,
        episodes=EpisodeColumns(
            **{name: tuple(getattr(table, name).tolist()) for name in kept},
            truncated=tuple(truncations[table.starts + table.lengths - 1].tolist()),
        ),
        frame=frame,
    )


def note_text(dataset: Dataset, frame: str) -> str:
    """The text of `note_of`; ConversionError also if `parse_note` would not read it."""
    text = note_of(dataset, frame).to_json()
    if len(text) > MAX_NOTE_BYTES:
        raise ConversionError(
            f"{dataset!r} has too many episodes for an export that can be imported again: its note "
            f"has {len(text):,} bytes, expected at most {MAX_NOTE_BYTES:,}. Export views of it."
        )
    return text


def write_note(dataset: Dataset, folder: Path, frame: str) -> None:
    """Writes the note of an export into its folder; raises as `note_text` does."""
    (folder / NOTE_FILE).write_text(note_text(dataset, frame), encoding="utf-8")


def read_note(folder: Path) -> ExportNote | None:
    """The note in a folder; None if there is none. Raises as `parse_note` does."""
    file = folder / NOTE_FILE
    return parse_note(file.read_bytes(), file) if file.is_file() else None


def parse_note(text: str | bytes, source: Path | str) -> ExportNote:
    """Reads a note; ConversionError if damaged, of one side, or of a frame but the world's."""
    try:
        note = ExportNote.parse(parse_json(text, str(source), MAX_NOTE_BYTES), str(source))
    except SpecError as error:
        raise ConversionError(
            f"the note of swarmdata in {source} cannot be read: {error}. Export the dataset again."
        ) from error
    if note.frame != "world":
        raise ConversionError(
            f"{source} was exported in the frame {note.frame!r}, which cannot be turned back to "
            f"the recorded numbers. Load {note.id}, or export it without --frame."
        )
    if isinstance(note.spec, SideSpec):
        raise ConversionError(
            f"{source} holds one side of {note.id}, the {note.spec.side}, without the agents of "
            f"the others. Load {note.id}, or import an export of it, and take the side of that."
        )
    return note


def check_team_rewards(team: NDArray[Any], rewards: NDArray[Any], where: str) -> None:
    """Raises ConversionError for team rewards, [n], that are not the means of rewards, [n, N].

    Who changes both rounds twice, so the means differ in their last bits.
    """
    means = rewards.mean(axis=1, dtype=np.float64)
    rounded = 4 * np.finfo(np.float32).eps * np.abs(rewards).max(axis=1)
    if not (np.abs(team - means) <= rounded).all():
        raise ConversionError(
            f"{where}: `rewards` were changed after the export, and are not the means of "
            "`infos/agent_rewards`, which are read. Change those too, or remove the note to "
            "convert it as foreign data."
        )


def import_with_note(
    note: ExportNote, read: ReadRows, n_rows: int, source: str, layouts: Float | None = None
) -> ImportedData:
    """Imports data that this library exported; ConversionError if rows do not fit the note.

    Arrays that `read` gives of states come twice, also after each step (`NEXT_PREFIX`); obstacles
    of each episode, [n, M, 8], only if they were kept.
    """
    lengths = note.episodes.lengths
    if sum(lengths) != n_rows:
        raise ConversionError(
            f"{source} has {n_rows} rows, but its note of swarmdata says {sum(lengths)}. It was "
            "changed after the export: remove the note to convert it as foreign data."
        )
    if layouts is not None and len(layouts) != len(lengths):
        raise ConversionError(
            f"{source} has {len(layouts)} layouts, but its note of swarmdata says {len(lengths)} "
            "episodes. It was changed after the export."
        )

    def episodes() -> Iterator[Episode]:
        start = 0
        advice = "The rows were shuffled or changed after the export."
        for k, n in enumerate(lengths):
            found = read(slice(start, start + n))
            admit_exported(found, n, f"{source}, rows {start} to {start + n - 1}")
            rows = join_states(found, n, source, start, advice)
            _check_end(rows, source, start)
            yield note.episode(k, rows, None if layouts is None else layouts[k])
            start += n

    return note.imported(episodes())


def _check_end(rows: Arrays, source: str, start: int) -> None:
    ends = rows["terminations"] | rows["truncations"]
    both = rows["terminations"] & rows["truncations"]
    if ends[:-1].any() or not ends[-1] or both.any():
        raise ConversionError(
            f"{source}: the episode of rows {start} to {start + len(ends) - 1} does not end "
            "exactly once, in its last row: the rows were changed after the export."
        )
