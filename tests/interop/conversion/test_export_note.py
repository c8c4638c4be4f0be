"""The note of an export: whatever is written can be read."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion import export_note
from swarmdata.interop.conversion.export_note import note_of, parse_note
from swarmdata.interop.export import export_dataset


def test_a_note_of_half_a_million_episodes_is_read(tiny: Path) -> None:
    note = note_of(Dataset.open(tiny), "world")
    long = note.to_json() + " " * (1 << 24)  # as long as theirs, and read at once
    assert parse_note(long, "here") == note


@pytest.mark.parametrize("format", ["parquet", "d4rl"])
def test_a_note_that_could_not_be_read_is_not_written(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    monkeypatch.setattr(export_note, "MAX_NOTE_BYTES", 100)
    with pytest.raises(ConversionError, match=r"bytes, expected at most 100\. Export views of it"):
        export_dataset(Dataset.open(tiny), tmp_path / "out", format=format)
    assert not any(tmp_path.iterdir())
