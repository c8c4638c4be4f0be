"""The card and the references beside a dataset are written, compared and written anew."""

import shutil
from pathlib import Path

import pytest

from swarmdata.cards.side_files import damage_of, finish
from swarmdata.hub.catalog.repair import Repair, examine, repair
from swarmdata.registry.presets import preset
from swarmdata.store.arrays.layout import CARD, REFERENCES
from tests.support.one_process import use_one_process
from tests.support.pairs import slow
from tests.support.tiny import make_tiny


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small dataset of a task whose references were measured."""
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        return make_tiny(tmp_path_factory.mktemp("made") / "d", spec=preset("coop_nav"))


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "d"))


@pytest.mark.parametrize("change", ["cut", *slow("absent", "other")])
def test_damaged_references_show_and_are_written_anew(folder: Path, change: str) -> None:
    """Row 46: there was nothing to compare."""
    file = folder / REFERENCES
    content = file.read_bytes()
    if change == "absent":
        file.unlink()
    else:
        file.write_bytes(content.replace(b"9", b"8", 1) if change == "other" else content[:-40])
    (damage,) = examine(folder)
    assert damage.file == REFERENCES
    assert ("is absent" if change == "absent" else "the first that differs") in damage.problem
    assert repair(folder) == (Repair(REFERENCES, "written anew"),)
    assert file.read_bytes() == content
    assert examine(folder) == ()


def test_a_release_without_references_gets_them(folder: Path) -> None:
    content = (folder / REFERENCES).read_bytes()
    (folder / REFERENCES).unlink()
    (folder / CARD).write_text("as its publisher wrote it")
    finish(folder)
    assert (folder / REFERENCES).read_bytes() == content
    assert (folder / CARD).read_text() == "as its publisher wrote it"
    assert [damage.file for damage in damage_of(folder)] == [CARD]


def test_a_task_without_references_has_no_such_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_one_process(monkeypatch)
    folder = make_tiny(tmp_path / "d", n_steps=160)
    assert not (folder / REFERENCES).exists()
    assert examine(folder) == ()
    (folder / CARD).unlink()
    finish(folder)
    assert (folder / CARD).exists()
    assert not (folder / REFERENCES).exists()
