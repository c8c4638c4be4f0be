"""The folder of a catalogue: complete or absent, and never in the place of something else."""

import json
import shutil
from contextlib import AbstractContextManager
from pathlib import Path

from swarmdata.runtime.output_folder import OutputKind, filled

CATALOGUE = OutputKind("catalogue", "catalogue.json")


def replaced_site(folder: Path) -> AbstractContextManager[Path]:
    """Yields a new folder that takes the place of a catalogue when the block ends well.

    Until then an earlier catalogue stays as it is; an interrupted build leaves nothing. Files that
    are not of the catalogue, such as those of git, stay where they are.

    Args:
        folder: absent, empty, or a catalogue.

    Raises:
        OutputError: something else is there.
        DiskFullError: no space was left.
    """
    return filled(folder, CATALOGUE, whole=True)


def is_site(folder: Path) -> bool:
    """Whether a folder is a catalogue."""
    try:
        content = json.loads((folder / CATALOGUE.list_file).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("format") == CATALOGUE.format


def copy_assets(assets: Path, site: Path) -> None:
    """Copies the scripts and the style sheet into a site."""
    (site / "assets").mkdir()
    for file in sorted(assets.iterdir()):
        if file.suffix in (".js", ".css"):
            shutil.copyfile(file, site / "assets" / file.name)
