"""Crash-safe publishing: temporary sibling, fsync, rename, fsync of the parent folder.

Readers see the old state or the new one, whatever is killed and whenever.
"""

import contextlib
import errno
import glob
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

from swarmdata.errors import DiskFullError

TEMPORARY = ".tmp-"
"""Prefix of what is not published yet."""


LITTLE = 1 << 20
"""With fewer bytes free, a failed write is blamed on the disk."""


def temporary_sibling(path: Path) -> Path:
    """Returns a fresh name in the same folder, so that the final rename stays in one filesystem."""
    return path.parent / f"{TEMPORARY}{path.name}-{uuid.uuid4().hex}"


def sync(path: Path) -> None:
    """Flushes one file or folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Flushes every file and folder below and including `folder`."""
    for root, _, files in os.walk(folder):
        for name in files:
            sync(Path(root, name))
        sync(Path(root))


def write_file(path: Path, content: bytes) -> None:
    """Publishes one file; an existing file is replaced in one step."""
    temporary = temporary_sibling(path)
    try:
        temporary.write_bytes(content)
        sync(temporary)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync(path.parent)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yields a temporary sibling that becomes `path` when the block ends without an error.

    Where another process has published `path` first, this copy is discarded: folders are
    immutable, so the first one stands.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_sibling(path)
    temporary.mkdir()
    try:
        yield temporary
        sync_tree(temporary)
        _publish(temporary, path)
    except OSError as error:
        _explain_full_disk(error, path, temporary)
        raise
    finally:
        if temporary.exists():
            shutil.rmtree(temporary)
    sync(path.parent)


def _explain_full_disk(error: OSError, path: Path, temporary: Path) -> None:
    """Raises `DiskFullError` if that is what an error of writing means.

    NumPy and the C library report a short write without a number, so the free space decides too.
    """
    free = shutil.disk_usage(path.parent).free
    if error.errno not in (errno.ENOSPC, errno.EDQUOT) and free > LITTLE:
        return
    written = sum(file.stat().st_size for file in temporary.rglob("*") if file.is_file())
    raise DiskFullError(
        f"no space is left in {path.parent} for {path.name}: {written / 1e6:.1f} MB of it were "
        f"written, {free / 1e6:.1f} MB are free, more is needed. Nothing half-written is kept, and "
        "what was finished before is. Make room and run the same again to go on."
    ) from error


def _publish(temporary: Path, path: Path) -> None:
    """Renames, unless a folder with content is there already."""
    try:
        temporary.rename(path)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise


def remove_leftovers(folder: Path, name: str | None = None) -> None:
    """Deletes what killed writers left in `folder`; only whoever holds its lock may call this.

    Args:
        folder: where to look; it need not exist.
        name: of the file or folder that they were writing; None: any.
    """
    written = "*" if name is None else f"{glob.escape(name)}-{'[0-9a-f]' * 32}"
    for leftover in folder.glob(f"{TEMPORARY}{written}"):
        if leftover.is_dir() and not leftover.is_symlink():
            shutil.rmtree(leftover)
        else:
            leftover.unlink()
