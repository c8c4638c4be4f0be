"""Crash-safe publishing: temporary sibling, fsync, rename, fsync of the parent folder.

Readers see the old state or the new one, whatever is killed and whenever.
"""

import contextlib
import errno
import os
import re
import shutil
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from swarmdata.errors import DiskFullError

TEMPORARY = ".tmp-"
"""Prefix of what is not published yet."""

_LEFTOVER = re.compile(rf"{re.escape(TEMPORARY)}(.+)-[0-9a-f]{{32}}", re.DOTALL)
"""Names that `temporary_sibling` makes, with the name of what was written."""

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


def remove_leftovers(folder: Path, *names: str | re.Pattern[str]) -> None:
    """Deletes what killed writers left in `folder`; only whoever holds its lock may call this.

    Only names that `temporary_sibling` makes are deleted, and each is shown on standard error.
    Whatever else begins with `.tmp-` is somebody else's.

    Args:
        folder: where to look; it need not exist.
        names: of the files and folders that they were writing, or patterns of such names.
    """
    if not folder.is_dir():
        return
    for each in sorted(folder.iterdir()):
        match = _LEFTOVER.fullmatch(each.name)
        if match is None or each.is_symlink():  # a writer makes no links
            continue
        if any(_is_named(match[1], name) for name in names):
            _remove(each)
            tqdm.write(f"removed {each}, which a killed process left", file=sys.stderr)


def _is_named(found: str, name: str | re.Pattern[str]) -> bool:
    return found == name if isinstance(name, str) else name.fullmatch(found) is not None


def _remove(path: Path) -> None:
    """Deletes a file or a whole folder."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
