"""What the environment says: where the cache is, and whether the network may be used."""

import os
from pathlib import Path

from platformdirs import user_cache_path

from swarmdata.errors import DatasetNotFoundError

MANIFEST = "manifest.json"  # the file in a folder that makes it a finished dataset

OFFLINE_VARIABLES = ("SWARMDATA_OFFLINE", "HF_HUB_OFFLINE")
"""Variables of the environment that keep `load` from asking remotes."""


def offline_variable() -> str | None:
    """The first of `OFFLINE_VARIABLES` that is set to 1, on, yes or true; None: none is."""
    words = {name: os.environ.get(name, "").strip().upper() for name in OFFLINE_VARIABLES}
    return next((name for name in words if words[name] in ("1", "ON", "YES", "TRUE")), None)


def cache_folder() -> Path:
    """Where datasets are kept: `SWARMDATA_CACHE`, else the user's cache folder.

    Raises:
        DatasetNotFoundError: it leads nowhere, over a symbolic link whose target is gone.
    """
    named = os.environ.get("SWARMDATA_CACHE")
    folder = Path(named) if named else user_cache_path("swarmdata")
    for part in (folder, *folder.parents):
        if part.is_symlink() and not part.exists():
            raise DatasetNotFoundError(
                f"the cache is {folder}, and {part} is a symbolic link to {part.readlink()}, which "
                "is not there. Make or mount it, or set SWARMDATA_CACHE to another folder."
            )
    return folder
