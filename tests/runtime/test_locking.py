"""Whoever changes a file has it alone, from reading to having written."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest

from swarmdata.errors import BuildError
from swarmdata.runtime import locking
from swarmdata.runtime.locking import REMINDER, SILENCE, Lock, is_mount_point, locked


def start(code: str, *arguments: str | Path) -> "subprocess.Popen[str]":
    code = f"import sys; sys.path[:] = {sys.path!r}\n{code}"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


COUNT = """
from pathlib import Path
from swarmdata.runtime.locking import locked
path = Path(sys.argv[1])
for _ in range(50):
    with locked(path, shown=False):
        n = int(path.read_text())
        path.write_text(str(n + 1))
"""

COME_AND_GO = """
from pathlib import Path
from swarmdata.runtime.locking import locked
for _ in range(200):
    with locked(Path(sys.argv[1]), shown=False):
        pass
"""

HOLD = """
import time
from pathlib import Path
from swarmdata.runtime.locking import locked
with locked(Path(sys.argv[1]), shown=False):
    print("held", flush=True)
    time.sleep(600)
"""


def start_three(code: str, path: Path) -> None:
    processes = [start(code, path) for _ in range(3)]
    results = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], results


def test_no_change_of_many_processes_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "count"
    path.write_text("0")
    start_three(COUNT, path)
    assert path.read_text() == "150"
    assert [each.name for each in tmp_path.iterdir()] == ["count"], "no lock is left"


def test_who_waits_says_for_whom_and_takes_over_from_the_dead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    holder = start(HOLD, tmp_path / "x")
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    waiter = start(HOLD.replace("shown=False", "shown=True"), tmp_path / "x")
    assert waiter.stderr is not None
    assert waiter.stdout is not None
    assert f"x is in use by process {holder.pid} on " in waiter.stderr.readline()
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    assert waiter.stdout.readline() == "held\n"
    waiter.send_signal(signal.SIGKILL)
    waiter.communicate()
    assert [each.name for each in tmp_path.iterdir()] == [".x.lock"]
    with locked(tmp_path / "x", shown=False):
        assert (tmp_path / ".x.lock").read_text().startswith(f"process {os.getpid()} on ")
    assert list(tmp_path.iterdir()) == []


def test_an_error_inside_frees_the_lock(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), locked(tmp_path / "deep" / "x", shown=False):
            raise ZeroDivisionError
        assert not (tmp_path / "deep").exists(), "it was made for the file, and holds nothing"
    (tmp_path / "deep").mkdir()
    with locked(tmp_path / "deep" / "x", shown=False):
        pass
    assert (tmp_path / "deep").exists(), "it is the user's"


def test_a_folder_that_comes_and_goes_stops_nobody(tmp_path: Path) -> None:
    start_three(COME_AND_GO, tmp_path / "deep" / "x")
    with locked(tmp_path / "deep" / "x", shown=False):
        (tmp_path / "deep" / "x").touch()
    assert [each.name for each in (tmp_path / "deep").iterdir()] == ["x"]


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    message = r"x cannot be made or changed in .*choose another one"
    with pytest.raises(BuildError, match=message), locked(tmp_path / "file" / "x", shown=False):
        pass


@pytest.mark.parametrize(("umask", "mode"), [(0o002, 0o664), (0o022, 0o644), (0o077, 0o600)])
def test_the_umask_says_who_else_may_take_over_a_lock(
    tmp_path: Path, umask: int, mode: int
) -> None:
    before = os.umask(umask)
    try:
        with locked(tmp_path / "data"):
            assert (tmp_path / ".data.lock").stat().st_mode & 0o777 == mode
    finally:
        os.umask(before)


def test_another_user_who_holds_a_lock_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a shared folder, where the umask lets others read a lock and not write to it."""
    lock, opened = tmp_path / ".x.lock", os.open

    def refuse(path: str, flags: int, *mode: int) -> int:
        if flags & os.O_RDWR and lock.exists() and not flags & os.O_CREAT:
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, flags, *mode)

    monkeypatch.setattr(os, "open", refuse)
    in_use = pytest.raises(BuildError, match="in use by process")
    with locked(tmp_path / "x"), in_use, locked(tmp_path / "x", patience=0.1):
        pass
    lock.touch()
    message = r"\.x\.lock was left by a process of another user"
    with pytest.raises(BuildError, match=message), locked(tmp_path / "x"):
        pass


@pytest.mark.parametrize("kind", ["link", "dangling link", "hard link", "file", "folder", "pipe"])
def test_what_is_in_the_place_of_a_lock_is_left(tmp_path: Path, kind: str) -> None:
    """Row 75: a link led to a file of somebody else, which was overwritten."""
    place, key = tmp_path / "shared" / ".x.lock", tmp_path / "key"
    place.parent.mkdir()
    key.write_text("secret")
    plant: dict[str, Callable[[], object]] = {
        "link": lambda: place.symlink_to(key),
        "dangling link": lambda: place.symlink_to(tmp_path / "new"),
        "hard link": lambda: place.hardlink_to(key),
        "file": lambda: place.write_text("mine"),
        "folder": place.mkdir,
        "pipe": lambda: os.mkfifo(place),
    }
    plant[kind]()
    before = place.lstat()
    message = r"\.x\.lock is in the way: .* Move it away"
    with pytest.raises(BuildError, match=message), locked(tmp_path / "shared" / "x"):
        pass
    assert key.read_text() == "secret"
    assert not (tmp_path / "new").exists()
    assert (place.lstat().st_ino, place.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert kind != "file" or place.read_text() == "mine"


def test_who_does_not_want_to_wait_is_told_for_whom(tmp_path: Path) -> None:
    with locked(tmp_path / "x"):
        message = f"x is in use by process {os.getpid()} on .* Wait for it"
        with pytest.raises(BuildError, match=message), locked(tmp_path / "x", patience=0.0):
            pass
    with locked(tmp_path / "x", patience=0.0):
        pass


class Clock:
    """Time that passes only while somebody sleeps, and what happens meanwhile."""

    def __init__(self) -> None:
        self.now = 0.0
        self.meanwhile: Callable[[float], object] = lambda now: None

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.meanwhile(self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(locking, "time", made)
    return made


@pytest.fixture
def no_locks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on some mounts of NFS, Lustre and FUSE."""
    number = getattr(request, "param", errno.ENOLCK)
    monkeypatch.setattr(fcntl, "flock", Mock(side_effect=OSError(number, os.strerror(number))))


@pytest.mark.parametrize(("shown", "n_lines"), [(True, 4), (False, 3)])
def test_who_waits_says_so_every_ten_seconds(
    tmp_path: Path, clock: Clock, capsys: pytest.CaptureFixture[str], shown: bool, n_lines: int
) -> None:
    held = Lock(tmp_path / "lock", "x")
    assert held.acquire()
    assert not Lock(tmp_path / "lock", "x").acquire(35.0, shown=shown)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == n_lines
    assert all(f"x is in use by process {os.getpid()} on" in line for line in lines)
    held.release()


@pytest.mark.parametrize("no_locks", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP], indirect=True)
def test_without_locks_of_the_system_the_file_is_the_lock(
    no_locks: None, tmp_path: Path, clock: Clock
) -> None:
    """Row 76: one such system was waited for without end, others had no lock at all."""
    with locked(tmp_path / "x"):
        with pytest.raises(BuildError, match="in use"), locked(tmp_path / "x", patience=60.0):
            pass
        assert [path.name for path in tmp_path.iterdir()] == [".x.lock"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("no_locks")
def test_without_locks_of_the_system_the_dead_are_known_by_their_silence(
    tmp_path: Path, clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / ".x.lock").write_text("process 7 on elsewhere")
    living, touched = 4 * SILENCE, [0]

    def touch(now: float) -> None:
        if now < living:
            touched[0] += 1
            os.utime(tmp_path / ".x.lock", ns=(touched[0], touched[0]))

    clock.meanwhile = touch
    with locked(tmp_path / "x"):
        assert living + SILENCE < clock.now < living + SILENCE + 2.0
        assert f"process {os.getpid()} on" in (tmp_path / ".x.lock").read_text()
    assert list(tmp_path.iterdir()) == []
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 5 * SILENCE / (REMINDER + 0.25)
    assert all("x is in use by process 7 on elsewhere" in line for line in lines)


@pytest.mark.usefixtures("no_locks")
def test_without_locks_of_the_system_one_of_two_takes_over(tmp_path: Path, clock: Clock) -> None:
    """The file of the dead is another process's by the time that it is removed."""
    (tmp_path / "lock").write_text("process 7 on elsewhere")
    late = Lock(tmp_path / "lock", "x")
    assert not late.acquire(0.0)
    seen = late._seen
    clock.now += 2 * SILENCE
    early = Lock(tmp_path / "lock", "x")
    early._seen = seen
    assert early.acquire(1.0)
    late._take_away()
    assert (tmp_path / "lock").read_text().startswith(f"process {os.getpid()} on")
    assert [path.name for path in tmp_path.iterdir()] == ["lock"]
    assert not late.acquire(1.0)
    early.release()
    assert late.acquire(1.0)
    late.release()


@pytest.mark.usefixtures("no_locks")
def test_without_locks_of_the_system_a_holder_shows_that_it_lives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touched = threading.Event()
    monkeypatch.setattr(locking, "PULSE", 0.001)
    monkeypatch.setattr(os, "utime", lambda descriptor: touched.set())
    with locked(tmp_path / "x"):
        assert touched.wait(60.0)


def test_a_lock_that_was_taken_away_is_not_removed_by_its_former_holder(tmp_path: Path) -> None:
    former, present = Lock(tmp_path / "lock", "x"), Lock(tmp_path / "lock", "x")
    assert former.acquire()
    (tmp_path / "lock").unlink()
    assert present.acquire()
    former.release()
    assert (tmp_path / "lock").exists()
    present.release()


def test_no_process_locks_a_file_that_another_one_removes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock, left = fcntl.flock, [1]

    def remove_first(descriptor: int, operation: int) -> None:
        if left:
            left.pop()
            (tmp_path / "lock").unlink()
        flock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", remove_first)
    lock = Lock(tmp_path / "lock", "x")
    assert lock.acquire(0.0)
    assert (tmp_path / "lock").exists()
    lock.release()


@pytest.mark.usefixtures("no_locks")
@pytest.mark.parametrize("no_locks", [errno.EIO], indirect=True)
def test_another_error_of_the_system_is_named(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="Input/output error"), locked(tmp_path / "x"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_mounted_folder_has_its_lock_inside(mounted: Path) -> None:
    assert is_mount_point(mounted)
    assert not is_mount_point(mounted.parent)
    with locked(mounted):
        assert (mounted / f".{mounted.name}.lock").exists()
    assert list(mounted.iterdir()) == []
    assert [path.name for path in mounted.parent.iterdir()] == [mounted.name]
