"""What makes a folder a catalogue."""

from pathlib import Path

from swarmdata.errors import OutputError
from swarmdata.runtime.output_folder import OutputKind, listed_files

CATALOGUE = OutputKind("catalogue", "catalogue.json")


def is_site(folder: Path) -> bool:
    """Whether a folder is a catalogue."""
    try:
        return bool(listed_files(folder, CATALOGUE))
    except OutputError:
        return False
