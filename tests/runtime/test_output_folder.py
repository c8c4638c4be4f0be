"""In a folder that a command writes to, nothing changes but what such a command wrote there."""

import json
import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from swarmdata.building.build import build
from swarmdata.errors import OutputError
from swarmdata.hub.catalog.sources import obtain_release
from swarmdata.runtime.atomic import UNFINISHED, is_vacant, new_folder
from swarmdata.runtime.output_folder import OutputKind, check_output, filled, remove_others
from swarmdata.store import open_store
from tests.faults.kill_points import Operation, survived
from tests.support.pairs import slow
from tests.support.tiny import TINY, Shelf, abandoned

REPORT, SITE = OutputKind("report"), OutputKind("site", "site.json")


def write(folder: Path, *, whole: bool = False, **files: str) -> None:
    """Writes files, whose names have `__` for `/` and no suffix."""
    with filled(folder, SITE if whole else REPORT, whole=whole) as target:
        for name, text in files.items():
            path = target / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)


def texts(folder: Path) -> dict[str, str]:
    """The files that can be seen, without the list."""
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (REPORT.list_file, SITE.list_file)
    }


def listed(folder: Path) -> list[str]:
    found: list[str] = json.loads((folder / REPORT.list_file).read_bytes())["files"]
    return found


def fill_twice(folder: Path, whole: bool) -> None:
    write(folder, whole=whole, a="1", deep__b="2")
    assert texts(folder) == {"a": "1", "deep/b": "2"}
    write(folder, whole=whole, a="3")
    assert texts(folder) == ({"a": "3"} if whole else {"a": "3", "deep/b": "2"})
    assert len(list(folder.parent.iterdir())) == 1
    assert not list(folder.glob(".tmp*"))
    assert not list(folder.glob("*.lock"))


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("is_there", [False, True])
def test_a_vacant_folder_is_filled(tmp_path: Path, is_there: bool, whole: bool) -> None:
    folder = tmp_path / "outer" / "out"
    (folder if is_there else folder.parent).mkdir(parents=True)
    fill_twice(folder, whole)


@pytest.mark.parametrize("whole", [False, True])
def test_a_mounted_folder_is_filled(mounted: Path, whole: bool) -> None:
    fill_twice(mounted, whole)


@pytest.mark.parametrize("whole", [False, True])
def test_files_of_the_user_stay(tmp_path: Path, whole: bool) -> None:
    write(tmp_path, whole=whole, a="1", deep__b="2")
    (tmp_path / "deep" / "mine").write_text("mine")
    (tmp_path / "link").symlink_to("a")
    write(tmp_path, whole=whole, a="3", c="4")
    left = {} if whole else {"deep/b": "2"}
    assert texts(tmp_path) == {"a": "3", "c": "4", "deep/mine": "mine", "link": "3"} | left


def test_files_that_are_not_written_again_go_when_told(tmp_path: Path) -> None:
    write(tmp_path, a="1", deep__b="2", c="3")
    (tmp_path / "mine").write_text("mine")
    remove_others(tmp_path, REPORT, ["a", "c"])
    assert texts(tmp_path) == {"a": "1", "c": "3", "mine": "mine"}
    assert not (tmp_path / "deep").exists()


@pytest.mark.parametrize("kind", ["file", "folder", "link", "linked folder", "file for a folder"])
@pytest.mark.parametrize("whole", [False, True])
def test_what_is_in_the_way_of_a_new_file_is_named_and_nothing_changed(
    tmp_path: Path, kind: str, whole: bool
) -> None:
    folder, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    write(folder, whole=whole, a="1")
    new, deep = folder / "new", folder / "deep"
    plant: dict[str, Callable[[], object]] = {
        "file": lambda: new.write_text("mine"),
        "folder": lambda: write(new, x="mine"),
        "link": lambda: new.symlink_to(tmp_path / "nowhere"),
        "linked folder": lambda: deep.symlink_to(elsewhere),
        "file for a folder": lambda: deep.write_text("mine"),
    }
    plant[kind]()
    before = texts(folder)
    with pytest.raises(OutputError, match=r"(new|deep) is in the way: .* Nothing was changed"):
        write(folder, whole=whole, a="2", new="3", deep__b="4")
    assert texts(folder) == before
    assert list(elsewhere.iterdir()) == []
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("name", ["../key", "/etc/key", "deep/../../key", ""])
def test_a_list_that_leads_out_of_the_folder_is_none(tmp_path: Path, name: str) -> None:
    """Whoever shares the folder may have written the list."""
    folder = tmp_path / "out"
    write(folder, whole=True, a="1")
    (tmp_path / "key").write_text("secret")
    file = folder / SITE.list_file
    file.write_text(json.dumps({**json.loads(file.read_bytes()), "files": [name]}))
    with pytest.raises(OutputError, match="does not list the files of one"):
        write(folder, whole=True, a="2")
    assert (tmp_path / "key").read_text() == "secret"


def test_a_listed_file_behind_a_link_is_not_removed(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    write(folder, whole=True, a="1", deep__b="2")
    shutil.move(folder / "deep", elsewhere)
    (folder / "deep").symlink_to(elsewhere)
    write(folder, whole=True, a="3")
    assert (elsewhere / "b").read_text() == "2"


@pytest.mark.parametrize(
    "content", ["{", "[]", "{}", '{"format": "swarmdata-report"}', '{"format": 1, "files": [1]}']
)
def test_a_list_of_something_else_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / REPORT.list_file).write_text(content)
    with pytest.raises(OutputError, match="is no report of this version"):
        check_output(tmp_path, REPORT)


def test_an_error_leaves_everything(tmp_path: Path) -> None:
    def fail(folder: Path) -> None:
        with filled(folder, REPORT) as target:
            (target / "a").write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
    write(tmp_path / "old", a="1")
    with pytest.raises(ZeroDivisionError):
        fail(tmp_path / "old")
    assert texts(tmp_path / "old") == {"a": "1"}


@pytest.mark.slow
@pytest.mark.parametrize(("stride", "has_own"), [(4, True), (1, True), (1, False)])
def test_a_kill_before_any_change_of_the_disk_loses_nothing(
    tmp_path: Path, stride: int, has_own: bool
) -> None:
    """A folder with files of the user's is filled one file after the other, another in a rename."""

    def earlier(place: Path) -> None:
        place.mkdir(exist_ok=True)
        write(place / "out", whole=True, a="1", old="1")
        if has_own:
            (place / "out" / "mine").write_text("mine")

    def check(place: Path) -> None:
        if has_own:
            assert (place / "out" / "mine").read_text() == "mine"
        if has_own or (place / "out").exists():  # there is none between two renames
            assert (place / "out" / "a").read_text() in "12"

    operation = Operation(
        earlier, lambda place: write(place / "out", whole=True, a="2", new="2"), check
    )
    _, n_kills = survived(operation, tmp_path, stride)
    assert n_kills >= 8 // stride


@pytest.mark.usefixtures("one_process")
@pytest.mark.parametrize("mounted", ["tmpfs", *slow("bind")], indirect=True)
def test_a_dataset_is_built_and_pulled_to_an_empty_and_to_a_mounted_folder(
    tmp_path: Path, tiny: Path, mounted: Path
) -> None:
    """Row 77: `generate` said that there is no dataset, a pull left its copy outside."""
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", mounted):
        shelf = Shelf(tmp_path / f"shelf-{folder.name}", tiny)
        release = shelf.find(TINY.id)
        assert release is not None
        for make in (
            partial(build, TINY, folder, progress=False),
            partial(obtain_release, shelf, release, folder, progress=False),
        ):
            make()
            assert open_store(folder, "full").manifest.id == TINY.id
            assert {path.name for path in folder.iterdir()} == {p.name for p in tiny.iterdir()}
            for each in folder.iterdir():
                shutil.rmtree(each) if each.is_dir() else each.unlink()
    assert [path.name for path in mounted.parent.iterdir()] == [mounted.name]


def test_a_mounted_folder_is_vacant_until_everything_is_there(
    mounted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was moved there before a kill is made way of by the next process."""

    def fill() -> None:
        with new_folder(mounted, last="last") as target:
            for name in ("a", "last", "z"):
                (target / name).write_text("new")

    rename = Path.rename

    def interrupted(path: Path, target: Path) -> Any:
        if path.name == "last":
            raise KeyboardInterrupt
        return rename(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", interrupted)
        with pytest.raises(KeyboardInterrupt):
            fill()
    assert {path.name for path in mounted.iterdir()} == {"a", "z", UNFINISHED}
    (mounted / "lost+found").mkdir()
    abandoned(mounted / mounted.name)
    assert is_vacant(mounted)
    fill()
    assert {path.name for path in mounted.iterdir()} == {"a", "last", "lost+found", "z"}
    assert not is_vacant(mounted)


@pytest.mark.parametrize("kind", ["of another user", "link", "garbage", "elsewhere"])
def test_no_word_of_another_user_makes_files_ours(mounted: Path, kind: str) -> None:
    (mounted / "thesis").write_text("mine")
    note = mounted / UNFINISHED
    note.write_text(json.dumps(["thesis"]))
    if kind == "of another user":
        os.chown(note, 4242, -1)
    elif kind == "link":
        shutil.move(note, mounted.parent / "note")
        note.symlink_to(mounted.parent / "note")
    else:
        note.write_text("{" if kind == "garbage" else json.dumps(["../mounted/thesis", 3]))
    assert not is_vacant(mounted)
    with pytest.raises(OutputError, match="has files in it"):
        write(mounted, a="1")
    assert (mounted / "thesis").read_text() == "mine"


def test_names_of_ours_are_the_users_where_nothing_is_mounted(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    (folder / "d.build").mkdir(parents=True)
    assert not is_vacant(folder)
    (tmp_path / "file").write_text("")
    assert not is_vacant(tmp_path / "file")


def test_what_a_call_left_that_was_killed_while_files_took_their_places_goes(
    tmp_path: Path,
) -> None:
    """It had begun before the folder was there, beside it."""
    write(tmp_path / "out", a="1")
    left = abandoned(tmp_path / "out")
    write(tmp_path / "out", a="2")
    assert not left.exists()
    assert texts(tmp_path / "out") == {"a": "2"}
