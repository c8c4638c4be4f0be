"""The cache folder of this machine, and the record of datasets that were built here."""

import contextlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from platformdirs import user_cache_path

from swarmdata.errors import DatasetNotFoundError
from swarmdata.runtime.atomic import write_file

if TYPE_CHECKING:
    from swarmdata.store.manifest import Manifest


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


def note_build(manifest: "Manifest") -> None:
    """Records that a dataset was built here, for `was_built_here`.

    The record is beside the datasets, not in them: it neither travels with a copy nor survives a
    change of recipe or arrays.
    """
    record = _record(manifest)
    with contextlib.suppress(OSError):  # a read-only cache has no such records
        record.parent.mkdir(parents=True, exist_ok=True)
        content = {"id": manifest.id, "digest": manifest.digest, "recipe": manifest.recipe_hash}
        write_file(record, json.dumps(content).encode())


def was_built_here(manifest: "Manifest") -> bool:
    """Whether a dataset of these arrays and this recipe was built here."""
    return _record(manifest).is_file()


def _record(manifest: "Manifest") -> Path:
    name = f"{manifest.recipe_hash[:32]}-{manifest.digest[:32]}.json"
    return cache_folder() / "built" / name
