"""Locks: one process at a time makes or changes a folder or file; the others wait and say why."""

import errno
import fcntl
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout
from tqdm import tqdm

from swarmdata.errors import BuildError


@contextmanager
def locked(folder: Path, shown: bool = True) -> Iterator[None]:
    """Holds the lock of a folder, which need not exist.

    The operating system releases the lock of a process that is killed, and the next one takes over.
    Two files lie beside the folder: `.<name>.lock` stays, `.<name>.owner` says who holds it.

    Args:
        folder: a dataset's; its parents are created.
        shown: whether to say on standard error that this process waits, and for which one.

    Raises:
        BuildError: nothing can be written there.
    """
    folder = folder.resolve()  # `.` has no name, and a link is another name of the same folder
    lock = FileLock(folder.parent / f".{folder.name}.lock")
    owner = folder.parent / f".{folder.name}.owner"
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        _acquire(lock, owner, folder, shown)
        owner.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
    except OSError as error:
        lock.release()
        raise BuildError(
            f"{folder.name} cannot be made or changed in {folder.parent}: {error.strerror or error}"
            ". Set SWARMDATA_CACHE to a folder that can be written to, or name one."
        ) from error
    try:
        yield
    finally:
        owner.unlink(missing_ok=True)
        lock.release()


def _acquire(lock: FileLock, owner: Path, folder: Path, shown: bool) -> None:
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if shown:
            tqdm.write(f"{folder} is in use by {_holder(owner)}; waiting for it.", file=sys.stderr)
        lock.acquire()


def _holder(owner: Path) -> str:
    """The process that holds the lock; it is unknown until it has written its name."""
    try:
        return owner.read_text(encoding="utf-8") or "another process"
    except OSError:
        return "another process"


@contextmanager
def updating(path: Path, shown: bool = False) -> Iterator[None]:
    """Holds a file, or the folder that it describes, from reading it to having written it.

    One process at a time is inside, so no change is lost and no two runs share a folder; the others
    wait. The lock, `.<name>.lock` beside the file, says who holds it and goes with the last one.
    A folder that was made for the file goes as well where nothing was written there.

    Args:
        path: of the file, which need not exist; its folder is made.
        shown: whether to say on standard error that this process waits, and for which one.

    Raises:
        BuildError: nothing can be written there.
    """
    note, is_new = path.parent / f".{path.name}.lock", not path.parent.exists()
    try:
        lock = _taken(note, path, shown)
    except OSError as error:
        raise BuildError(
            f"{path.name} cannot be made or changed in {path.parent}: {error.strerror or error}. "
            "Choose a folder that can be written to."
        ) from error
    try:
        yield
    finally:
        note.unlink(missing_ok=True)  # before the unlock, so that no process locks a deleted file
        os.close(lock)
        if is_new:
            _remove_if_empty(path.parent)


def _taken(note: Path, path: Path, shown: bool) -> int:
    """The descriptor that holds the lock; of a file that its last holder has removed, once more."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock = os.open(note, os.O_RDWR | os.O_CREAT, 0o644)
        except FileNotFoundError:  # its last holder has just removed the empty folder
            continue
        try:
            _flock(lock, note, path, shown)
            if os.fstat(lock).st_nlink:
                os.truncate(lock, 0)
                os.write(lock, f"process {os.getpid()} on {socket.gethostname()}".encode())
                return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


def _flock(lock: int, note: Path, path: Path, shown: bool) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if shown:
            tqdm.write(f"{path} is in use by {_holder(note)}; waiting for it.", file=sys.stderr)
        fcntl.flock(lock, fcntl.LOCK_EX)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            raise
        tqdm.write(
            f"{path.parent} is on a file system without locks: start nothing else there meanwhile.",
            file=sys.stderr,
        )
