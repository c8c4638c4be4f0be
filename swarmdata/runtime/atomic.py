"""Crash-safe publishing: a folder beside the target, fsync, rename, fsync of the parent folder.

What is not published lies in a temporary folder with a marker, the lock of its writer: by it the
next one who writes there knows a leftover from a user's folder, and from a living writer's.
"""

import contextlib
import errno
import json
import os
import re
import shutil
import stat
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from swarmdata.errors import BuildError, DiskFullError, ProgramError, SwarmdataError
from swarmdata.runtime.locking import Lock, beside

TEMPORARY_PREFIX = ".tmp-"  # prefix of what is not published yet

LEFTOVER = re.compile(rf"{re.escape(TEMPORARY_PREFIX)}(.+)-[0-9a-f]{{32}}", re.DOTALL)
"""Names of temporary folders, with the name of what was written."""

MARKER_FILE = ".swarmdata-temporary"
"""File in a temporary folder of ours; locked while its writer lives."""

REMOVAL_ATTEMPTS, REMOVAL_PAUSE = 50, 0.1
"""How often the removal of a temporary folder is tried again, and seconds between two tries."""

LOW_SPACE_BYTES = 1 << 20  # with fewer bytes free, a failed write is blamed on the disk

UNFINISHED = ".swarmdata-unfinished.json"
"""File at a mount point that lists what is being moved there."""


def own_files(folder: Path) -> set[str]:
    """Names in a mounted folder that are of our work on it, which elsewhere is beside it."""
    if beside(folder) != folder:
        return set()
    name = folder.name
    # the first of them is in every new file system
    known = {"lost+found", f".{name}.lock", f"{name}.build", f"{name}.recording"}
    known |= {UNFINISHED, *_unfinished(folder)} if _unfinished(folder) else set()
    scratch = re.compile(rf"\.?\.swarmdata-{re.escape(name)}\..*")
    return {
        each.name
        for each in folder.iterdir()
        if each.name in known or LEFTOVER.fullmatch(each.name) or scratch.fullmatch(each.name)
    }


def _unfinished(folder: Path) -> list[str]:
    """Names of what was being moved into a mount point; none by the word of another user."""
    note = folder / UNFINISHED
    try:
        status = note.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid():
            return []
        names = json.loads(note.read_bytes())
    except (OSError, ValueError):
        return []
    is_list = isinstance(names, list) and all(isinstance(each, str) for each in names)
    return [each for each in names if Path(each).name == each] if is_list else []


def is_vacant(folder: Path) -> bool:
    """Whether a new folder may be made here: nothing is there, or a folder without content."""
    if not os.path.lexists(folder):
        return True
    return folder.is_dir() and {each.name for each in folder.iterdir()} <= own_files(folder)


def put_in_place(source: Path, path: Path, last: str = "") -> None:
    """Makes a finished file or folder visible: in one rename, where nothing is mounted at `path`.

    A file there is replaced, a folder only if it `is_vacant`. A mount point cannot be renamed, so
    the content of `source` is moved into it piece by piece, at the end that which is called `last`
    and makes the folder complete. Where that is interrupted, the folder still `is_vacant`.
    """
    if beside(path) != path:
        source.rename(path)
        return
    note = path / UNFINISHED
    for piece in (path / name for name in _unfinished(path)):
        if piece.is_dir() and not piece.is_symlink():
            shutil.rmtree(piece)
        else:
            piece.unlink(missing_ok=True)
    names = sorted((each.name for each in source.iterdir()), key=lambda name: (name == last, name))
    write_file(note, json.dumps(names).encode())
    for name in names:
        (source / name).rename(path / name)
    sync(path)
    note.unlink()


@contextlib.contextmanager
def staged(path: Path, install: Callable[[Path, Path], None] = put_in_place) -> Iterator[Path]:
    """Yields where to write a file or folder, which becomes `path` if the block ends well.

    The yielded path has the same name, in a temporary folder beside `path`. Parents are made. What
    killed writers of the same path left is removed first. An existing file is replaced, an existing
    folder only if it is empty.

    Raises:
        DiskFullError: no space, or no inode, was left.
        OSError: it cannot be written, or a folder with content is there already.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(beside(path), path.name)
    scratch: Path | None = None
    try:
        scratch, lock = _marked(path)
        target = scratch / path.name
        yield target
        sync_tree(target) if target.is_dir() else sync(target)
        install(target, path)
    except (OSError, RuntimeError, ValueError) as error:
        _raise_if_full(error, path, scratch)
        if scratch is None and isinstance(error, OSError):  # of a name that the caller never gave
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if scratch is not None:
            _remove(scratch)
            lock.release()
    sync(beside(path))


def write_file(path: Path, content: bytes) -> None:
    """Publishes one file; an existing file is replaced in one step.

    Raises:
        DiskFullError: no space was left.
    """
    with staged(path) as target:
        target.write_bytes(content)


@contextlib.contextmanager
def new_folder(path: Path, last: str = "") -> Iterator[Path]:
    """Yields a new folder that becomes `path` when the block ends without an error.

    Where another process has published `path` first, this copy is discarded. `last` is that of
    `put_in_place`.

    Raises:
        DiskFullError: no space was left.
    """
    try:
        with staged(path, partial(put_in_place, last=last)) as target:
            target.mkdir()
            yield target
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not _is_published(error, path):
            raise


@contextlib.contextmanager
def disk_full_explained(path: Path, folder: Path | None = None) -> Iterator[None]:
    """Turns errors of a full disk into `DiskFullError`, where a file is added to in place.

    The file is `path`, or is that in the end and now grows in `folder`.

    Raises:
        DiskFullError: no space, or no inode, was left.
    """
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        _raise_if_full(error, path, folder)
        raise


def require_space(path: Path, needed: int) -> None:
    """Raises DiskFullError if the disk of a path has fewer bytes free than are needed."""
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
            _remove_marked(scratch)
            return
        except OSError as error:
            if not scratch.exists():  # the next writer took the empty folder for a leftover
                return
            if error.errno not in (errno.ENOTEMPTY, errno.ENOENT):
                raise
            time.sleep(REMOVAL_PAUSE)
    _remove_marked(scratch)


def _remove_marked(folder: Path) -> None:
    """Removes a temporary folder, its marker last: what a kill leaves of it is still ours."""
    for each in folder.iterdir():
        if each.is_dir() and not each.is_symlink():
            shutil.rmtree(each)
        elif each.name != MARKER_FILE:
            each.unlink()
    shutil.rmtree(folder)


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

    Each is shown on standard error. Nothing else is touched. With `names`, or patterns of them,
    only what was to become a file or folder so called is deleted.
    """
    patterns = [re.compile(re.escape(name)) if isinstance(name, str) else name for name in names]
    for each in sorted(folder.iterdir()) if folder.is_dir() else ():
        match = LEFTOVER.fullmatch(each.name)
        if match and (not names or any(pattern.fullmatch(match[1]) for pattern in patterns)):
            _remove_if_abandoned(each)


def _marked(path: Path) -> tuple[Path, Lock]:
    """Makes a temporary folder with a marker, and returns it and the lock that the marker is."""
    while True:
        scratch = beside(path) / f"{TEMPORARY_PREFIX}{path.name}-{uuid.uuid4().hex}"
        scratch.mkdir()
        lock = Lock(scratch / MARKER_FILE, scratch)
        try:
            if lock.acquire(0.0):
                return scratch, lock
        except FileNotFoundError:
            pass  # somebody took it for a leftover, before it was locked
        except BaseException:  # an interrupt comes after the marker was written as well
            lock.release()
            shutil.rmtree(scratch, ignore_errors=True)  # what stays is a leftover without an owner
            raise


def _remove_if_abandoned(folder: Path) -> None:
    """Removes a temporary folder of ours whose writer is dead, and says so."""
    lock = Lock(folder / MARKER_FILE, folder)
    try:
        if folder.is_symlink() or not lock.acquire(0.0, create=False):
            return
    except FileNotFoundError:  # killed before the marker was there, or after it was removed
        with contextlib.suppress(OSError):  # it has content, which is somebody's, or is gone
            folder.rmdir()
        return
    except (OSError, BuildError):  # no folder, or not ours to write in
        return
    _remove_marked(folder)
    lock.release()
    from tqdm import tqdm  # noqa: PLC0415  (slow to import, rarely needed)

    tqdm.write(f"removed {folder}, which a killed process left", file=sys.stderr)


def _is_published(error: OSError, path: Path) -> bool:
    """Whether a rename failed because a folder with content is there."""
    return error.filename2 is not None and Path(error.filename2) == path and path.is_dir()


def _raise_if_full(error: Exception, path: Path, scratch: Path | None) -> None:
    """Raises `DiskFullError` if that is what an error means, by its number or the space left."""
    if isinstance(error, SwarmdataError) and not isinstance(error, ProgramError):
        return
    found = os.statvfs(path.parent)
    free = found.f_bavail * found.f_frsize
    lacks_inodes = found.f_files > 0 and found.f_favail == 0
    # NumPy, which asks for the room beforehand, says no number, and others have their own words
    numbers = errno.ENOSPC, errno.EDQUOT
    said = isinstance(error, OSError) and (
        error.errno in numbers or str(error).startswith("Not enough free space")
    )
    if not said and free > LOW_SPACE_BYTES and not lacks_inodes:
        return
    files = [path] if scratch is None else list(scratch.rglob("*"))
    written = 512 * sum(file.stat().st_blocks for file in files if file.is_file())
    lack, cure = ("space", "Make room") if not lacks_inodes else ("inode", "Free some inodes")
    raise DiskFullError(
        f"no {lack} is left in {path.parent} for {path.name}: {written / 1e6:.1f} MB of it were "
        f"written, {free / 1e6:.1f} MB are free, more is needed. Nothing half-written is kept, and "
        f"what was finished before is. {cure} and run the same again to go on."
    ) from error
