"""The folder of a catalogue: complete or absent, and never in the place of something else."""

import contextlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

from swarmdata.errors import SchemaError
from swarmdata.runtime.atomic import staged

MARKER = "catalogue.json"
"""File that tells a catalogue's folder from others."""

FORMAT = "swarmdata-catalogue"


@contextlib.contextmanager
def replaced_site(folder: Path) -> Iterator[Path]:
    """Yields a new folder that takes the place of a catalogue when the block ends well.

    Until then an earlier catalogue stays as it is; an interrupted build leaves nothing. Between two
    renames at the end there is neither, so whoever reads meanwhile has to try again.

    Args:
        folder: absent, empty, or a catalogue.

    Raises:
        SchemaError: something else is there.
        DiskFullError: no space was left.
    """
    check_site(folder)
    with staged(folder) as target:
        target.mkdir()
        yield target
        content = json.dumps({"format": FORMAT, "format_version": 1})
        (target / MARKER).write_text(content + "\n", encoding="utf-8")
        check_site(folder)
        if folder.is_dir():
            folder.rename(target.parent / "earlier")  # deleted with the temporary folder


def check_site(folder: Path) -> None:
    """Checks that a folder may be replaced by a catalogue.

    Raises:
        SchemaError: it is no folder, or has content and is no catalogue.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise SchemaError(
            f"--out is {folder}, which is not a folder. Name a new folder, or a catalogue's."
        )
    if folder.is_dir() and any(folder.iterdir()) and not is_site(folder):
        raise SchemaError(
            f"{folder} has files in it and is no catalogue (it has no {MARKER}), so it is not "
            "replaced. Name a new folder, or empty this one."
        )


def is_site(folder: Path) -> bool:
    """Whether a folder is a catalogue."""
    try:
        content = json.loads((folder / MARKER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT


def copy_assets(assets: Path, site: Path) -> None:
    """Copies the scripts and the style sheet into a site."""
    (site / "assets").mkdir()
    for file in sorted(assets.iterdir()):
        if file.suffix in (".js", ".css"):
            shutil.copyfile(file, site / "assets" / file.name)
