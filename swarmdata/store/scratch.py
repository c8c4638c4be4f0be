"""Folders of unfinished work beside a dataset's folder, which the next process continues."""

import hashlib
import os
import shutil
from pathlib import Path

from swarmdata.errors import DatasetError
from swarmdata.runtime.locking import beside

SCRATCH_PREFIX = ".swarmdata-"  # of the names of scratch folders


def scratch_folder(path: Path, purpose: str) -> Path:
    """Where work such as `repair` keeps what is not finished, beside a dataset's folder.

    The name ends with a digest of itself, by which it is ours, and is the same in every process.

    Raises:
        DatasetError: there is a symbolic link, which is not followed.
    """
    whole = path.resolve()  # `.` and `..` have no name of their own
    name = f"{whole.name}.{purpose}"
    mark = hashlib.sha256(b"scratch folder of swarmdata: " + os.fsencode(name)).hexdigest()[:16]
    folder = beside(whole) / f"{SCRATCH_PREFIX}{name.removeprefix(SCRATCH_PREFIX)}-{mark}"
    if folder.is_symlink():
        raise DatasetError(
            f"{folder} is a symbolic link, expected a folder of unfinished work on {whole.name} or "
            "nothing. It was not followed; move it away."
        )
    return folder


def remove_scratch(folder: Path) -> None:
    """Deletes a folder that `scratch_folder` has named, if it is there."""
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder)
