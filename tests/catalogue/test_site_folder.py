"""The folder of a catalogue is complete or absent, and replaces nothing but a catalogue."""

from pathlib import Path

import pytest

from swarmdata.catalogue.site_folder import MARKER, is_site, replaced_site
from swarmdata.errors import SchemaError
from tests.faults.kill_points import Operation, survived


def write_site(folder: Path, text: str) -> None:
    with replaced_site(folder) as site:
        (site / "index.html").write_text(text)


def test_a_catalogue_replaces_an_earlier_one(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_site(folder, "one")
    (folder / "left.html").write_text("of the first")

    write_site(folder, "two")

    assert sorted(path.name for path in folder.iterdir()) == [MARKER, "index.html"]
    assert (folder / "index.html").read_text() == "two"
    assert list(tmp_path.iterdir()) == [folder]


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    write_site(tmp_path, "one")

    assert is_site(tmp_path)


@pytest.mark.parametrize("marker", [None, "{", "[]", '{"format": "other"}'])
def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, marker: str | None) -> None:
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    if marker is not None:
        (folder / MARKER).write_text(marker)

    with pytest.raises(SchemaError, match="is no catalogue"):
        write_site(folder, "one")

    assert (folder / "thesis.tex").read_text() == "years of work"
    assert not is_site(folder)


def test_a_file_or_a_link_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    (tmp_path / "link").symlink_to(tmp_path)

    for name in ("file", "link"):
        with pytest.raises(SchemaError, match="is not a folder"):
            write_site(tmp_path / name, "one")


def test_an_interrupted_build_leaves_what_was_there(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_site(folder, "one")

    def interrupted() -> None:
        with replaced_site(folder) as site:
            (site / "index.html").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()

    assert (folder / "index.html").read_text() == "one"
    assert list(tmp_path.iterdir()) == [folder]


def test_what_came_while_building_is_not_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "site"

    def surprised() -> None:
        with replaced_site(folder):
            folder.mkdir()
            (folder / "mine.txt").write_text("text")

    with pytest.raises(SchemaError, match="is no catalogue"):
        surprised()

    assert (folder / "mine.txt").read_text() == "text"


def test_a_kill_before_any_change_of_the_disk_leaves_a_whole_catalogue(tmp_path: Path) -> None:
    """The earlier or the new one, or none for the moment between them; the next build cleans up."""

    def earlier(place: Path) -> None:
        place.mkdir()
        write_site(place / "site", "one")

    def check(place: Path) -> None:
        if (place / "site").exists():
            assert is_site(place / "site")
            assert (place / "site" / "index.html").read_text() in ("one", "two")

    operation = Operation(earlier, lambda place: write_site(place / "site", "two"), check)

    _, n_kills = survived(operation, tmp_path, 1)

    assert n_kills >= 8
