"""The cache folder of this machine."""

import os
from pathlib import Path

from platformdirs import user_cache_path

from swarmdata.errors import DatasetNotFoundError

MANIFEST = "manifest.json"  # the file in a folder that makes it a finished dataset


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
