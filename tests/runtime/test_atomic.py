"""What is published is whole; what killed writers left goes, and nothing else does."""

import errno
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import DEFAULT, Mock

import pytest

from swarmdata.errors import CheckpointError, DiskFullError
from swarmdata.runtime.atomic import (
    MARKER_FILE,
    new_folder,
    remove_leftovers,
    require_space,
    staged,
    write_file,
)
from tests.runtime.test_locking import start
from tests.support.tiny import abandoned

HEX = "0" * 32

WRITER = """
import time
from pathlib import Path
from swarmdata.runtime.atomic import staged
with staged(Path(sys.argv[1])) as target:
    target.mkdir()
    (target / "half").write_text("x")
    print("writing", flush=True)
    time.sleep(600)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def writer(path: Path) -> "subprocess.Popen[str]":
    """A process in the middle of writing `path`."""
    process = start(WRITER, path)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    return process


def test_what_is_published_has_its_name_while_it_is_written(tmp_path: Path) -> None:
    with staged(tmp_path / "deep" / "x.png") as target:
        assert (target.name, target.parent.parent) == ("x.png", tmp_path / "deep")
        target.write_text("new")
        assert not (tmp_path / "deep" / "x.png").exists()
    assert names(tmp_path / "deep") == ["x.png"]
    write_file(tmp_path / "deep" / "x.png", b"newer")
    assert (tmp_path / "deep" / "x.png").read_bytes() == b"newer"
    assert names(tmp_path / "deep") == ["x.png"]


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, OSError, CheckpointError])
def test_an_error_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    write_file(tmp_path / "x", b"old")

    def write_half() -> None:
        with staged(tmp_path / "x") as target:
            target.write_text("new")
            raise error

    with pytest.raises(error):
        write_half()
    assert (tmp_path / "x").read_bytes() == b"old"
    assert names(tmp_path) == ["x"]


def interrupted(line: int, call: Callable[[], object]) -> bool:
    """Whether a call came as far as some line of the library, where an interrupt struck it."""
    seen = 0

    def trace(frame: FrameType, event: str, _: object) -> Callable[..., Any] | None:
        nonlocal seen
        if f"{os.sep}swarmdata{os.sep}runtime" not in frame.f_code.co_filename:
            return None
        seen += event in ("line", "return")
        if seen > line:
            sys.settrace(None)
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def test_an_interrupt_at_any_line_stays_one_and_leaves_a_whole_file_or_none(tmp_path: Path) -> None:
    line, found = 0, set()
    path = tmp_path / "0" / "x"
    while interrupted(line, partial(write_file, path, b"whole")):
        found.add(path.read_bytes() if path.exists() else None)
        line += 1
        path = tmp_path / str(line) / "x"
    assert line > 50
    assert found == {None, b"whole"}


def test_a_thread_that_still_writes_after_the_error_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As TensorStore's do: the first of their errors is raised, the others go on."""
    busy = OSError(errno.ENOTEMPTY, "Directory not empty")
    late = Mock(wraps=shutil.rmtree, side_effect=[busy, busy, DEFAULT, DEFAULT])
    monkeypatch.setattr(shutil, "rmtree", late)

    def fail() -> None:
        with staged(tmp_path / "a") as target:
            target.mkdir()
            raise ValueError("the first error")

    with pytest.raises(ValueError, match="the first"):
        fail()
    assert late.call_count == 4  # twice in vain, then the folder inside, and ours
    assert not list(tmp_path.glob(".tmp-*"))


@pytest.mark.parametrize("is_folder", [True, False])
def test_all_is_on_the_disk_before_it_has_its_name_and_the_name_before_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_folder: bool
) -> None:
    """Power may fail at any moment: what can be seen afterwards is whole."""
    flushed: list[Path] = []
    opened = Path("/proc/self/fd")
    monkeypatch.setattr(os, "fsync", lambda file: flushed.append((opened / str(file)).readlink()))
    with staged(tmp_path / "x") as target:
        if is_folder:
            (target / "deep").mkdir(parents=True)
            (target / "deep" / "file").write_text("whole")
        else:
            target.write_text("whole")
    written = [target, target / "deep", target / "deep" / "file"] if is_folder else [target]
    assert sorted(flushed[:-1]) == written
    assert flushed[-1] == tmp_path


def test_the_first_of_two_folders_stands(tmp_path: Path) -> None:
    with new_folder(tmp_path / "d") as second, new_folder(tmp_path / "d") as first:
        (first / "first").touch()
        (second / "second").touch()
    assert names(tmp_path / "d") == ["first"]
    assert names(tmp_path) == ["d"]


def test_a_folder_with_content_is_not_replaced_by_an_export(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "theirs").touch()
    with pytest.raises(OSError, match="d"), staged(tmp_path / "d") as target:
        target.mkdir()
    assert names(tmp_path / "d") == ["theirs"]
    assert names(tmp_path) == ["d"]


def test_a_killed_writer_is_cleaned_up_by_the_next_one(tmp_path: Path) -> None:
    process = writer(tmp_path / "d")
    (half,) = tmp_path.iterdir()
    remove_leftovers(tmp_path)
    assert half.exists(), "its writer lives"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert half.exists(), "a killed writer cleans nothing up"
    write_file(tmp_path / "other", b"")
    assert half.exists(), "of another path"
    write_file(tmp_path / "d", b"")
    assert names(tmp_path) == ["d", "other"]


def test_nothing_of_the_users_is_removed(tmp_path: Path) -> None:
    (tmp_path / f".tmp-x-{HEX}").mkdir()
    (tmp_path / f".tmp-x-{HEX}" / "thesis.tex").write_text("by hand")
    for name in (".tmp-", ".tmp-notes", f".tmp-x-{'1' * 32}"):
        (tmp_path / name).write_text("a file")
    for name in (".tmp-x", f".tmp-x-{'a' * 31}", f".tmp-x-{'g' * 32}", "elsewhere"):
        (tmp_path / name).mkdir()
        (tmp_path / name / MARKER_FILE).touch()
    (tmp_path / f".tmp-x-{'2' * 32}").symlink_to(tmp_path / "elsewhere")
    before = names(tmp_path)
    remove_leftovers(tmp_path)
    remove_leftovers(tmp_path, "x")
    write_file(tmp_path / "x", b"")
    assert names(tmp_path) == sorted([*before, "x"])
    assert (tmp_path / "elsewhere" / MARKER_FILE).exists()


def test_leftovers_of_some_names_or_of_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("x", "x-y", "[a]*?", "part-1", "part-2"):
        abandoned(tmp_path / name)
    remove_leftovers(tmp_path, "x", re.compile(r"part-\d"))
    assert len(names(tmp_path)) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3, "each is named"
    assert all("which a killed process left" in line for line in said)
    remove_leftovers(tmp_path, "[a]*?")
    assert [name.startswith(".tmp-x-y-") for name in names(tmp_path)] == [True]
    remove_leftovers(tmp_path)
    assert names(tmp_path) == []
    remove_leftovers(tmp_path / "nowhere")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_or_quota_is_one_error(tmp_path: Path, number: int) -> None:
    message = r"no space is left in .* for x: 0\.0 MB"
    with pytest.raises(DiskFullError, match=message), staged(tmp_path / "x"):
        raise OSError(number, os.strerror(number))
    assert names(tmp_path) == []


def test_a_library_that_fails_in_its_own_words_on_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def disk(free: int, inodes: int) -> None:
        made = Mock(f_bavail=free, f_frsize=1, f_files=9999, f_favail=inodes)
        monkeypatch.setattr(os, "statvfs", lambda path: made)

    def fail(error: Exception) -> None:
        with staged(tmp_path / "x"):
            raise error

    disk(1000, 1000)
    with pytest.raises(DiskFullError, match="no space is left"):
        fail(RuntimeError("Can't write data"))
    disk(1 << 30, 0)
    with pytest.raises(DiskFullError, match="no inode is left"):
        fail(RuntimeError("Can't write data"))
    disk(1 << 30, 1000)
    with pytest.raises(DiskFullError, match="no space is left"):  # NumPy asks beforehand
        fail(OSError("Not enough free space to write 34951168 bytes after offset 128"))
    with pytest.raises(RuntimeError, match="Can't write"):
        fail(RuntimeError("Can't write data"))
    disk(1000, 1000)
    with pytest.raises(CheckpointError):
        fail(CheckpointError("of ours, which says what is wrong itself"))


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EMFILE])
def test_what_cannot_be_made_is_named_as_the_caller_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    (tmp_path / "x").touch()
    error = OSError(number, os.strerror(number), str(tmp_path / "temporary"))
    monkeypatch.setattr(os, "mkdir", Mock(side_effect=error))
    with pytest.raises(OSError, match=os.strerror(number)) as caught:
        write_file(tmp_path / "x", b"new")
    assert caught.value.filename == str(tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == b""


def test_space_is_asked_for_before_it_is_needed(tmp_path: Path) -> None:
    require_space(tmp_path, 1)
    with pytest.raises(DiskFullError, match="MB more are needed"):
        require_space(tmp_path / ".", 1 << 60)


def test_without_locks_nothing_is_removed_and_everything_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half = abandoned(tmp_path / "x")
    refuse = Mock(side_effect=OSError(errno.ENOLCK, "No locks available"))
    monkeypatch.setattr(fcntl, "flock", refuse)
    write_file(tmp_path / "x", b"new")
    assert names(tmp_path) == [half.name, "x"]


def test_many_writers_of_one_file_leave_one_whole_file(tmp_path: Path) -> None:
    def write(letter: bytes) -> None:
        for _ in range(30):
            write_file(tmp_path / "x", letter * 1000)

    with ThreadPoolExecutor(3) as writers:
        list(writers.map(write, (b"a", b"b", b"c")))
    assert (tmp_path / "x").read_bytes() in (b"a" * 1000, b"b" * 1000, b"c" * 1000)
    assert names(tmp_path) == ["x"]


def test_what_was_killed_without_its_marker_is_empty_and_goes(tmp_path: Path) -> None:
    """Between the folder and its marker, or between the marker's end and the folder's."""
    (tmp_path / f".tmp-x-{HEX}").mkdir()
    remove_leftovers(tmp_path, "x")
    assert names(tmp_path) == []
