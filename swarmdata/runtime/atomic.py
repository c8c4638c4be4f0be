"""Crash-safe publishing: a folder beside the target, fsync, rename, fsync of the parent folder.

Readers see the old state or the new one, whatever is killed and whenever. What is not published yet
lies in a temporary folder with a marker, which its writer keeps locked: the operating system frees
the lock of a process that dies, so a leftover of ours is told from a folder of the user's and from
the work of a living process, and whoever writes there next removes it.
"""

import contextlib
import errno
import fcntl
import os
import re
import shutil
import socket
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from swarmdata.errors import DiskFullError, ProgramError, SwarmdataError

TEMPORARY_PREFIX = ".tmp-"
"""Prefix of what is not published yet."""

_LEFTOVER = re.compile(rf"{re.escape(TEMPORARY_PREFIX)}(.+)-[0-9a-f]{{32}}", re.DOTALL)
"""Names of temporary folders, with the name of what was written."""

MARKER_FILE = ".swarmdata-temporary"
"""File in a temporary folder of ours; locked while its writer lives."""

REMOVAL_ATTEMPTS = 50
"""How often the removal of a temporary folder is tried again, `REMOVAL_PAUSE` seconds apart."""

REMOVAL_PAUSE = 0.1

LOW_SPACE_BYTES = 1 << 20
"""With fewer bytes free, a failed write is blamed on the disk."""


@contextlib.contextmanager
def staged(path: Path) -> Iterator[Path]:
    """Yields where to write a file or folder, which becomes `path` if the block ends well.

    The yielded path has the same name, in a temporary folder beside `path`, so that the final
    rename stays in one filesystem. What killed writers of the same path left is removed first. An
    existing file is replaced, an existing folder only if it is empty.

    Args:
        path: of the file or folder; its parents are made.

    Raises:
        DiskFullError: no space, or no inode, was left.
        OSError: it cannot be written, or a folder with content is there already.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path.parent, path.name)
    scratch: Path | None = None
    try:
        scratch, lock = _marked(path)
        os.write(lock, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        target = scratch / path.name
        yield target
        sync_tree(target) if target.is_dir() else sync(target)
        target.rename(path)
    except (OSError, RuntimeError, ValueError) as error:
        _raise_if_full(error, path, scratch)
        if scratch is None and isinstance(error, OSError):  # of a name that the caller never gave
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if scratch is not None:
            _remove(scratch)
            os.close(lock)
    sync(path.parent)


def write_file(path: Path, content: bytes) -> None:
    """Publishes one file; an existing file is replaced in one step.

    Raises:
        DiskFullError: no space was left.
    """
    with staged(path) as target:
        target.write_bytes(content)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yields a new folder that becomes `path` when the block ends without an error.

    Where another process has published `path` first, this copy is discarded: folders are
    immutable, so the first one stands.

    Raises:
        DiskFullError: no space was left.
    """
    try:
        with staged(path) as target:
            target.mkdir()
            yield target
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not _is_published(error, path):
            raise


@contextlib.contextmanager
def disk_full_explained(path: Path, folder: Path | None = None) -> Iterator[None]:
    """Turns errors of a full disk into `DiskFullError`, where a file is added to in place.

    Args:
        path: what is written, for the message.
        folder: where it grows; None: at `path` itself.

    Raises:
        DiskFullError: no space, or no inode, was left.
    """
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        _raise_if_full(error, path, folder)
        raise


def require_space(path: Path, needed: int) -> None:
    """Raises where fewer bytes are free than are needed, before a library fails over it.

    Args:
        path: a file or folder on the disk.
        needed: bytes.

    Raises:
        DiskFullError: with both numbers.
    """
    free = shutil.disk_usage(path).free
    if free < needed:
        raise DiskFullError(
            f"no space is left for {path.name}: {needed / 1e6:.1f} MB more are "
            f"needed, {free / 1e6:.1f} MB are free. Make room and run the same again."
        )


def _remove(scratch: Path) -> None:
    """Removes a temporary folder, in which threads of a library may still end what failed."""
    for _ in range(REMOVAL_ATTEMPTS):
        try:
            shutil.rmtree(scratch)
            return
        except OSError as error:
            if error.errno != errno.ENOTEMPTY:
                raise
            time.sleep(REMOVAL_PAUSE)
    shutil.rmtree(scratch)


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


def remove_leftovers(folder: Path, *names: str | re.Pattern[str]) -> None:
    """Deletes what killed writers left in `folder`: temporary folders with our marker and no owner.

    Each is shown on standard error. Nothing else is touched: not what a living process is writing,
    and nothing of the user's, whatever it is called.

    Args:
        folder: where to look; it need not exist.
        names: of the files and folders that they were writing, or patterns of such names; without
            any, whatever they were writing.
    """
    if not folder.is_dir():
        return
    for each in sorted(folder.iterdir()):
        match = _LEFTOVER.fullmatch(each.name)
        if match is None or (names and not any(_is_named(match[1], name) for name in names)):
            continue
        with _taken_over(each) as is_ours:
            if is_ours:
                shutil.rmtree(each)
                tqdm.write(f"removed {each}, which a killed process left", file=sys.stderr)


def _is_named(found: str, name: str | re.Pattern[str]) -> bool:
    return found == name if isinstance(name, str) else name.fullmatch(found) is not None


def _marked(path: Path) -> tuple[Path, int]:
    """Makes a temporary folder with a locked marker; returns it and what holds the lock."""
    while True:
        scratch = path.parent / f"{TEMPORARY_PREFIX}{path.name}-{uuid.uuid4().hex}"
        scratch.mkdir()
        try:
            lock = os.open(scratch / MARKER_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except BaseException:
            scratch.rmdir()
            raise
        with contextlib.suppress(OSError):  # without locks here, leftovers stay: nobody can tell
            fcntl.flock(lock, fcntl.LOCK_EX)
        if os.fstat(lock).st_nlink:
            return scratch, lock
        os.close(lock)  # somebody took it for a leftover, before it was locked


@contextlib.contextmanager
def _taken_over(leftover: Path) -> Iterator[bool]:
    """Whether a folder is a temporary one of ours whose writer is dead; it is locked meanwhile."""
    try:
        lock = os.open(leftover / MARKER_FILE, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:  # no marker, no folder, or not ours to write in
        yield False
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        is_free = os.fstat(lock).st_nlink > 0 and not leftover.is_symlink()
    except OSError:
        is_free = False
    try:
        yield is_free
    finally:
        os.close(lock)


def _is_published(error: OSError, path: Path) -> bool:
    """Whether a rename failed because a folder with content is there."""
    return error.filename2 is not None and Path(error.filename2) == path and path.is_dir()


def _raise_if_full(error: Exception, path: Path, scratch: Path | None) -> None:
    """Raises `DiskFullError` if that is what an error of writing means.

    NumPy and the C library report a short write without a number, other libraries in words of
    their own, so the free space decides too.
    """
    if isinstance(error, SwarmdataError) and not isinstance(error, ProgramError):
        return
    found = os.statvfs(path.parent)
    free = found.f_bavail * found.f_frsize
    lacks_inodes = found.f_files > 0 and found.f_favail == 0
    said = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    if not said and free > LOW_SPACE_BYTES and not lacks_inodes:
        return
    files = [path] if scratch is None else list(scratch.rglob("*"))
    written = sum(file.stat().st_size for file in files if file.is_file())
    lack, cure = ("space", "Make room") if not lacks_inodes else ("inode", "Free some inodes")
    raise DiskFullError(
        f"no {lack} is left in {path.parent} for {path.name}: {written / 1e6:.1f} MB of it were "
        f"written, {free / 1e6:.1f} MB are free, more is needed. Nothing half-written is kept, and "
        f"what was finished before is. {cure} and run the same again to go on."
    ) from error
