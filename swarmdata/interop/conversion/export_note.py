"""ExportNote: the identity, spec and episode table that travel with exported data.

It is stored as text in an attribute or file of the foreign format. An import then reads episode
boundaries, spaces, splits and policies instead of inferring them.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SpecError
from swarmdata.runtime.documents import parse_json
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import AnySpec
from swarmdata.specs.origins.recording_origin import Id
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.recipe import PolicySource
from swarmdata.store import SPLITS
from swarmdata.types import END_REASONS, Counts

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
    """
    table, spec = dataset.episodes, dataset.spec
    if dataset.reweighting is not None:  # the spec of the export is that of its rewards
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
