"""The folder of a catalogue is complete or absent, and replaces nothing but a catalogue."""

from pathlib import Path

import pytest

from swarmdata.catalogue.site_folder import CATALOGUE, is_site, replaced_site
from swarmdata.errors import OutputError


def write_site(folder: Path, text: str) -> None:
    with replaced_site(folder) as site:
        (site / "index.html").write_text(text)


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


def test_what_came_while_building_is_not_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "site"

    def surprised() -> None:
        with replaced_site(folder):
            folder.mkdir()
            (folder / "mine.txt").write_text("text")

    with pytest.raises(OutputError, match="is no catalogue of"):
        surprised()

    assert (folder / "mine.txt").read_text() == "text"
