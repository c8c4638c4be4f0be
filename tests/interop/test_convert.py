"""Importing is whole or not at all, and can be done again."""

import os
from pathlib import Path
from typing import Any

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, OutputError, RecipeConflictError, UnknownNameError
from swarmdata.interop.conversion.imported_data import build_episode
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.store.scratch import scratch_folder
from swarmdata.types import Episode


@pytest.fixture(scope="module")
def source(ours: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_dataset(ours, tmp_path_factory.mktemp("source") / "x.hdf5", format="d4rl")


def test_an_interrupted_import_leaves_nothing_and_can_be_repeated(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = iter(range(100))

    def interrupted(*arguments: object, **facts: object) -> Episode:
        if next(count) == 5:
            raise KeyboardInterrupt
        return build_episode(*arguments, **facts)  # type: ignore[arg-type]

    monkeypatch.setattr("swarmdata.interop.conversion.export_note.build_episode", interrupted)
    monkeypatch.setattr("swarmdata.interop.convert.BLOCK_BYTES", 100)  # parts are written early
    with pytest.raises(KeyboardInterrupt):
        import_dataset(source, tmp_path / "out", format="d4rl", id="coop_nav-back-v0")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    left = scratch_folder(tmp_path / "out", "import")  # by a process that was killed
    (left / "policy-0-part-00000").mkdir(parents=True)
    made = import_dataset(source, tmp_path / "out", format="d4rl", id="coop_nav-back-v0")
    assert not left.exists()
    again = import_dataset(source, tmp_path / "out", format="d4rl", id="coop_nav-back-v0")
    assert again.digest == made.digest


def test_an_import_waits_for_the_disk_as_often_for_many_parts_as_for_few(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A killed import begins anew, so that only its dataset has to be on the disk."""
    flushed: list[int] = []
    monkeypatch.setattr(os, "fsync", flushed.append)
    import_dataset(source, tmp_path / "few", format="d4rl", id="coop_nav-back-v0")
    n_few = len(flushed)
    monkeypatch.setattr("swarmdata.interop.convert.BLOCK_BYTES", 100)
    import_dataset(source, tmp_path / "many", format="d4rl", id="coop_nav-back-v0")
    assert len(flushed) == 2 * n_few > 0


def test_answers_about_an_export_are_refused(source: Path, tmp_path: Path) -> None:
    """It has none of the questions, and would ignore them."""
    answers: dict[str, Any] = {"episode_length": 10, "time_limit": 5}
    with pytest.raises(ConversionError, match=r"got time_limit, episode_length as well\. Leave"):
        import_dataset(source, tmp_path / "a", format="d4rl", id="x-back-v1", **answers)
    assert list(tmp_path.iterdir()) == []
    import_dataset(source, tmp_path / "b", format="d4rl", id="x-back-v1", agents=None)
    with pytest.raises(UnknownNameError, match="unknown answer about foreign data 'time_limits'"):
        import_dataset(source, tmp_path / "c", format="d4rl", id="x-back-v1", time_limits=3)


def test_a_taken_folder_is_left_alone(source: Path, ours: Dataset, tmp_path: Path) -> None:
    with pytest.raises(RecipeConflictError, match="made from another recipe"):
        import_dataset(source, ours.path, format="d4rl", id="coop_nav-back-v0")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes").write_text("mine")
    with pytest.raises(OutputError, match="has files in it, such as notes"):
        import_dataset(source, tmp_path / "out", format="d4rl", id="coop_nav-back-v0")


def test_another_choice_of_splits_draws_none(source: Path, tmp_path: Path) -> None:
    splits: Any = "keep"
    with pytest.raises(UnknownNameError, match="Did you mean 'kept'"):
        import_dataset(source, tmp_path / "out", format="d4rl", id="coop_nav-b-v0", splits=splits)
    assert list(tmp_path.iterdir()) == []
