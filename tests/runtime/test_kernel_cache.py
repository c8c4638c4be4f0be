"""Compiled kernels are believed only if they are whole, and compiled by one process at a time."""

import errno
import fcntl
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from swarmdata.runtime import kernel_cache
from swarmdata.runtime.kernels import kernel


def compiled_twice() -> list[Callable[[float], float]]:
    """Two kernels as two processes would make them, one after the other."""

    def halve(x: float) -> float:
        return 0.5 * x

    return [kernel(halve), kernel(halve)]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for kernels, and nothing said yet."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(kernel_cache, "_said", set())
    return tmp_path / "kernels"


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-40] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
@pytest.mark.parametrize(
    "damage",
    [lambda f: f.write_bytes(b""), lambda f: f.write_bytes(b"\x80"), cut, flip],
    ids=["empty", "one byte", "half", "bit"],
)
def test_a_damaged_file_is_compiled_again_and_said_once(
    cache: Path, caplog: pytest.LogCaptureFixture, kind: str, damage: Callable[[Path], None]
) -> None:
    """Row 61: a truncated file was an EOFError without a name, a flipped bit other code."""
    first, second = compiled_twice()
    assert first(3.0) == 1.5
    (file,) = cache.rglob(kind)
    damage(file)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert second(3.0) == 1.5
        damage(file)
        assert compiled_twice()[0](5.0) == 2.5
    (said,) = [each.message for each in caplog.records if "damaged" in each.message]
    assert str(file.parent) in said
    assert "compiled again" in said
    third = compiled_twice()[0]
    assert third(3.0) == 1.5
    assert sum(third.stats.cache_hits.values()) == 1, "the file was replaced"  # type: ignore[attr-defined]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE])
def test_a_cache_that_cannot_be_written_is_said_once(
    cache: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """Row 61: a full disk was a raw OSError."""

    def refuse(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(IndexDataCacheFile, "_open_for_write", refuse)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert [each(3.0) for each in compiled_twice()] == [1.5, 1.5]
    (said,) = [each.message for each in caplog.records if "cannot be kept" in each.message]
    assert os.strerror(number) in said
    assert "SWARMDATA_CACHE" in said


TWO_PROCESSES = """
import sys, time
from numba import types
from numba.extending import overload
from swarmdata.runtime.kernels import kernel

def twice(x): ...

@overload(twice)
def compile_twice(x):
    time.sleep(2.0)  # as long as two processes that start together need to meet here
    return lambda x: 2.0 * x

@kernel
def double(x: float) -> float:
    return twice(x)

assert double(1.5) == 3.0
print(sum(double.stats.cache_misses.values()))
"""


def test_two_processes_compile_a_kernel_once(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(TWO_PROCESSES)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    both = [
        subprocess.Popen(
            [sys.executable, str(script)], env=environment, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]

    compiled = sorted(int(process.communicate()[0]) for process in both)

    assert compiled == [0, 1]


def test_a_kernel_that_fails_lets_others_compile_it(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[str] = []
    monkeypatch.setattr(kernel_cache, "_end_turn", lambda root, turn: ended.append(turn))

    @kernel
    def fail(x: float) -> float:
        return x.no_such_attribute  # type: ignore[attr-defined]

    with pytest.raises(Exception, match="no_such_attribute"):
        fail(1.0)
    assert any("fail" in turn for turn in ended)


def test_without_locks_every_process_compiles(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(fcntl, "lockf", refuse)

    assert [each(3.0) for each in compiled_twice()] == [1.5, 1.5]


def test_one_does_not_wait_for_ever(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that compiles may have been stopped."""

    def refuse(*arguments: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "held by another process")

    monkeypatch.setattr(fcntl, "lockf", refuse)
    monkeypatch.setattr(kernel_cache, "MAX_WAIT", 0.2)

    assert compiled_twice()[0](3.0) == 1.5
