"""Locks: one process at a time makes or changes a folder or file; the others wait and say why.

The lock of `name` is the file `.name.lock` beside it, which names its holder. The system frees it
when that one is killed. Where a file system has no locks (some of NFS, Lustre and FUSE), the file
itself is the lock, and a holder that has not touched it for `SILENCE` seconds is taken for dead.
"""

import contextlib
import errno
import fcntl
import math
import os
import re
import socket
import stat
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarmdata.errors import BuildError

PULSE = 10.0  # seconds between two touches of a lock file, where the file system has no locks

SILENCE = 120.0
"""Seconds without a touch after which a holder is dead there; NFS shows a touch after up to 60."""

REMINDER = 10.0  # seconds after which a process that waits says so, and says so again
_PAUSES = (0.01, 0.25)  # s; the first between two tries, and the longest

_ATTEMPTS = 1000

_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)

_HOLDER = re.compile(rb"process \d+ on [^\n]*\n?")


def beside(path: Path) -> Path:
    """The folder for what lies beside a path: its own, where a file system is mounted at it."""
    return path if is_mount_point(path) else path.parent


def is_mount_point(folder: Path) -> bool:
    """Whether a file system is mounted at a folder, which can then not be renamed or replaced."""
    if not folder.is_dir():
        return False
    if folder.is_mount():
        return True
    try:  # a folder that is mounted elsewhere in the same file system shows only here
        mounts = Path("/proc/self/mountinfo").read_bytes().splitlines()
    except OSError:
        return False
    place = re.sub(rb"[ \t\n\\]", lambda m: b"\\%03o" % m[0][0], os.fsencode(folder.resolve()))
    return any(line.split(b" ")[4] == place for line in mounts)


@contextmanager
def locked(path: Path, shown: bool = True, patience: float = math.inf) -> Iterator[None]:
    """Holds a folder or file, or the folder that a file describes; it need not exist.

    Folders that were made for the lock go with it, where nothing was written to them.

    Args:
        path: of the folder or file; its parents are made.
        shown: whether to say at once on standard error that this process waits, and for which one;
            it says so in any case after `REMINDER` seconds.
        patience: seconds to wait.

    Raises:
        BuildError: nothing can be written there, something else is in the place of the lock, or
            another process holds it for longer than `patience`.
    """
    path = path.resolve()  # `.` has no name, and a link is another name of the same folder
    folder = beside(path)
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    lock = Lock(folder / f".{path.name}.lock", path)
    try:
        is_held = _acquired(lock, patience, shown)
    except OSError as error:
        raise BuildError(
            f"{path.name} cannot be made or changed in {path.parent}: {error.strerror or error}. "
            "Set SWARMDATA_CACHE to a folder that can be written to, or choose another one."
        ) from error
    if not is_held:
        raise BuildError(
            f"{path} is in use by {lock.holder()}. Wait for it, or choose another path."
        )
    try:
        yield
    finally:
        lock.release()
        for each in made:
            _remove_if_empty(each)


def _acquired(lock: "Lock", patience: float, shown: bool) -> bool:
    """Takes a lock in a folder that its last holder may remove, when it is empty, as it is made."""
    for left in reversed(range(_ATTEMPTS)):
        try:
            lock.file.parent.mkdir(parents=True, exist_ok=True)
            return lock.acquire(patience, shown=shown)
        except (FileNotFoundError, FileExistsError):
            if not left:
                raise
    raise AssertionError("the last attempt returns or raises")


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


class Lock:
    """A file that one process at a time holds, and removes when it is done; its folder is there.

    Messages call what is locked `subject`. What else lies at its place, be it a link, is neither
    followed nor changed.
    """

    def __init__(self, file: Path, subject: object) -> None:
        self.file, self.subject = file, subject
        self._descriptor: int | None = None
        self._pulse: _Pulse | None = None
        self._seen: tuple[int, int] | None = None  # inode and time of a file that is the lock
        self._since = 0.0

    def acquire(
        self, patience: float = math.inf, *, shown: bool = True, create: bool = True
    ) -> bool:
        """Takes the lock; whether it could be taken.

        Args:
            patience: seconds to wait for its holder.
            shown: whether to say at once that this process waits.
            create: whether to make the file.

        Raises:
            BuildError: something else is at its place.
            OSError: it cannot be made or, without `create`, there is none.
        """
        begin, pause = time.monotonic(), _PAUSES[0]
        told = -math.inf if shown else begin
        while not self._try(create):
            now = time.monotonic()
            if now - begin >= patience:
                return False
            if now - told >= REMINDER:
                told = now
                from tqdm import tqdm  # noqa: PLC0415  (slow to import, rarely needed)

                tqdm.write(
                    f"{self.subject} is in use by {self.holder()}; waiting for it.", file=sys.stderr
                )
            time.sleep(pause)
            pause = min(1.5 * pause, _PAUSES[1])
        return True

    def release(self) -> None:
        """Gives the lock back and removes its file; nothing happens where it is not held."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is None:
            return
        if self._pulse is not None:
            self._pulse.end()
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), self.file.lstat()):
                self.file.unlink()  # before the unlock, so that no process locks a deleted file
        os.close(descriptor)

    def holder(self) -> str:
        """The process that holds the lock; it is unknown until it has written its name."""
        try:
            descriptor = os.open(self.file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            return "another process"
        with open(descriptor, "rb") as file:  # noqa: PTH123  (of a descriptor)
            content = file.read(1000)
        is_named = _HOLDER.fullmatch(content) is not None
        return content.decode("utf-8", "replace").strip() if is_named else "another process"

    def _try(self, create: bool) -> bool:
        """Takes the lock unless it is held; of a file that its holder has removed, once more."""
        while True:
            descriptor, is_new = self._open(create)
            try:
                self._check_ours(descriptor)
                is_taken, pulses = self._take(descriptor, is_new)
                if is_taken and os.fstat(descriptor).st_nlink:
                    self._sign(descriptor, pulses)
                    self._descriptor = descriptor
                    return True
            except BaseException:
                if is_new:
                    self.file.unlink(missing_ok=True)
                os.close(descriptor)
                raise
            os.close(descriptor)
            if not is_taken:
                return False

    def _open(self, create: bool) -> tuple[int, bool]:
        """Opens the file, and says whether it was made; a link is not followed."""
        flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK
        while True:
            if create:
                with contextlib.suppress(FileExistsError):
                    return os.open(self.file, flags | os.O_CREAT | os.O_EXCL, 0o666), True
            try:
                return os.open(self.file, flags), False
            except FileNotFoundError:  # its holder has just removed it
                if not create:
                    raise
            except PermissionError:  # of another user, who is waited for
                return os.open(self.file, flags & ~os.O_RDWR), False
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
                    raise _in_the_way(self.file, self.subject) from error
                raise

    def _take(self, descriptor: int, is_new: bool) -> tuple[bool, bool]:
        """Whether an open file is the lock of this process, and whether it has to be touched."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False, False
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            if not is_new and self._is_silent(descriptor):
                self._take_away()
            return is_new, True
        return True, False

    def _sign(self, descriptor: int, pulses: bool) -> None:
        if not fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_RDWR:
            problem = f"{self.file} was left by a process of another user"
            raise PermissionError(errno.EACCES, problem)
        os.truncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        if pulses:
            self._pulse = _Pulse(descriptor)
            self._pulse.start()

    def _check_ours(self, descriptor: int) -> None:
        """Raises BuildError unless a file is a lock: what else is there is left as it is."""
        status = os.fstat(descriptor)
        if stat.S_ISREG(status.st_mode) and status.st_nlink <= 1:
            content = os.pread(descriptor, 1000, 0)
            if not content or _HOLDER.fullmatch(content):
                return
        raise _in_the_way(self.file, self.subject)

    def _is_silent(self, descriptor: int) -> bool:
        """Whether nothing has happened to a file for long, by the clock of this machine."""
        status = os.fstat(descriptor)
        seen = status.st_ino, status.st_mtime_ns
        if seen != self._seen:
            self._seen, self._since = seen, time.monotonic()
        return time.monotonic() - self._since > SILENCE

    def _take_away(self) -> None:
        """Removes the file of a dead holder, unless another process has just taken it over."""
        aside = self.file.with_name(f"{self.file.name}.{uuid.uuid4().hex}")
        with contextlib.suppress(FileNotFoundError):  # another process was faster
            self.file.rename(aside)
            status = aside.lstat()
            if (status.st_ino, status.st_mtime_ns) == self._seen:
                aside.unlink()
            else:
                aside.rename(self.file)


class _Pulse(threading.Thread):
    """Touches a lock file as long as it is held."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(daemon=True)
        self._descriptor, self._ended = descriptor, threading.Event()

    def run(self) -> None:
        while not self._ended.wait(PULSE):
            with contextlib.suppress(OSError):  # a server that is away; the next touch may reach it
                os.utime(self._descriptor)

    def end(self) -> None:
        self._ended.set()
        self.join()


def _in_the_way(file: Path, subject: object) -> BuildError:
    return BuildError(
        f"{file} is in the way: the lock of {subject} belongs there, and it is not a lock file of "
        "swarmdata, so it was left as it is. Move it away, or choose another path."
    )
