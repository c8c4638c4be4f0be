"""One process at a time makes or changes a dataset's folder; the others wait and say for whom."""

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
        shown: whether to say on standard error that and for whom this process waits.

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
    """Who holds the lock, as far as it is known: between taking it and saying so is a moment."""
    try:
        return owner.read_text(encoding="utf-8") or "another process"
    except OSError:
        return "another process"
