"""Whoever changes a file has it alone, from reading to having written."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from swarmdata.errors import BuildError
from swarmdata.runtime.locking import updating


def start(code: str, *arguments: str | Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"import sys; sys.path[:] = {sys.path!r}\n{code}",
            *map(str, arguments),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


COUNT = """
from pathlib import Path
from swarmdata.runtime.locking import updating
path = Path(sys.argv[1])
for _ in range(50):
    with updating(path):
        n = int(path.read_text())
        path.write_text(str(n + 1))
"""

COME_AND_GO = """
from pathlib import Path
from swarmdata.runtime.locking import updating
for _ in range(200):
    with updating(Path(sys.argv[1])):
        pass
"""

HOLD = """
import time
from pathlib import Path
from swarmdata.runtime.locking import updating
with updating(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_no_change_of_many_processes_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "count"
    path.write_text("0")
    processes = [start(COUNT, path) for _ in range(3)]
    results = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], results
    assert path.read_text() == "150"
    assert [each.name for each in tmp_path.iterdir()] == ["count"], "no lock is left"


def test_who_waits_says_for_whom_and_takes_over_from_the_dead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    holder = start(HOLD, tmp_path / "x")
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    waiter = start(HOLD.replace("1])", "1]), True"), tmp_path / "x")
    assert waiter.stderr is not None
    assert waiter.stdout is not None
    assert f"x is in use by process {holder.pid} on " in waiter.stderr.readline()
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    assert waiter.stdout.readline() == "held\n"
    waiter.send_signal(signal.SIGKILL)
    waiter.communicate()
    assert [each.name for each in tmp_path.iterdir()] == [".x.lock"]
    with updating(tmp_path / "x"):
        assert (tmp_path / ".x.lock").read_text().startswith(f"process {os.getpid()} on ")
    assert list(tmp_path.iterdir()) == []


def test_an_error_inside_frees_the_lock(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), updating(tmp_path / "deep" / "x"):
            raise ZeroDivisionError
        assert not (tmp_path / "deep").exists(), "it was made for the file, and holds nothing"
    (tmp_path / "deep").mkdir()
    with updating(tmp_path / "deep" / "x"):
        pass
    assert (tmp_path / "deep").exists(), "it is the user's"


def test_a_folder_that_comes_and_goes_stops_nobody(tmp_path: Path) -> None:
    processes = [start(COME_AND_GO, tmp_path / "deep" / "x") for _ in range(3)]
    results = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], results
    with updating(tmp_path / "deep" / "x"):
        (tmp_path / "deep" / "x").touch()
    assert [each.name for each in (tmp_path / "deep").iterdir()] == ["x"]


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    message = r"x cannot be made or changed in .*Choose a folder"
    with pytest.raises(BuildError, match=message), updating(tmp_path / "file" / "x"):
        pass


def test_without_locks_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with updating(tmp_path / "x"):
        pass
    assert "on a file system without locks" in capsys.readouterr().err
