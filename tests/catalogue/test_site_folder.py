"""The folder of a catalogue is complete or absent, and replaces nothing but a catalogue."""

from pathlib import Path

import pytest

from swarmdata.catalogue.site_folder import CATALOGUE, is_site
from swarmdata.errors import OutputError
from swarmdata.runtime.output_folder import filled


def write_site(folder: Path, *, other: str | None = None) -> None:
    """Writes a page; meanwhile, something else comes there if it is named."""
    with filled(folder, CATALOGUE, whole=True) as site:
        (site / "index.html").write_text("one")
        if other is not None:
            folder.mkdir()
            (folder / other).write_text("text")


@pytest.mark.parametrize("marker", [None, "{", "[]", '{"format": "other"}'])
def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, marker: str | None) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    if marker is not None:
        (tmp_path / CATALOGUE.list_file).write_text(marker)
    with pytest.raises(OutputError, match="is no catalogue of"):
        write_site(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
    assert not is_site(tmp_path)


def test_what_came_while_building_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is no catalogue of"):
        write_site(tmp_path / "site", other="mine.txt")
    assert (tmp_path / "site" / "mine.txt").read_text() == "text"


def test_a_file_is_not_replaced_and_a_link_followed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder")
    with pytest.raises(OutputError, match="is not a folder"):
        write_site(tmp_path / "file")
    write_site(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert is_site(tmp_path / "folder")
