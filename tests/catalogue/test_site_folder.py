"""The folder of a catalogue is complete or absent, and replaces nothing but a catalogue."""

from pathlib import Path

import pytest

from swarmdata.catalogue.site_folder import CATALOGUE, is_site, replaced_site
from swarmdata.errors import OutputError
from tests.faults.kill_points import Operation, survived


def write_site(folder: Path, text: str) -> None:
    with replaced_site(folder) as site:
        (site / "index.html").write_text(text)


def test_a_catalogue_replaces_an_earlier_one(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    with replaced_site(folder) as site:
        (site / "index.html").write_text("one")
        (site / "left.html").write_text("of the first")

    write_site(folder, "two")

    assert sorted(path.name for path in folder.iterdir()) == [CATALOGUE.list_file, "index.html"]
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
        (folder / CATALOGUE.list_file).write_text(marker)

    with pytest.raises(OutputError, match="is no catalogue of"):
        write_site(folder, "one")

    assert (folder / "thesis.tex").read_text() == "years of work"
    assert not is_site(folder)


def test_a_file_is_not_replaced_and_a_link_followed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder")

    with pytest.raises(OutputError, match="is not a folder"):
        write_site(tmp_path / "file", "one")
    write_site(tmp_path / "link", "one")

    assert (tmp_path / "link").is_symlink()
    assert is_site(tmp_path / "folder")


def test_files_of_the_user_in_a_catalogue_stay(tmp_path: Path) -> None:
    """Row 77: a work tree of git was thrown away with the pages in it."""
    folder = tmp_path / "site"
    with replaced_site(folder) as site:
        (site / "index.html").write_text("one")
        (site / "old").mkdir()
        (site / "old" / "page.html").write_text("of the first")
    own = {".git/HEAD": "ref", "CNAME": "example.org", "old/notes.txt": "mine"}
    for name, text in own.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)

    write_site(folder, "two")

    assert (folder / "index.html").read_text() == "two"
    assert {name: (folder / name).read_text() for name in own} == own
    assert not (folder / "old" / "page.html").exists()
    assert list(tmp_path.iterdir()) == [folder]


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

    with pytest.raises(OutputError, match="is no catalogue of"):
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
