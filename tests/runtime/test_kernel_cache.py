"""Compiled kernels are believed only if they are whole, and compiled by one process at a time."""

import errno
import fcntl
import gc
import hashlib
import logging
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from numba.core import caching, config
from numba.core.caching import IndexDataCacheFile

from swarmdata.runtime import kernel_cache
from swarmdata.runtime.kernel_progress import PROGRESS
from swarmdata.runtime.kernels import kernel
from tests.support.tiny import flip


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


class Attack:
    """A pickle that makes a file when it is read."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


def give_away(file: Path, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes a file one that another user could have written."""
    if how != "owner":
        file.chmod(0o666 if how == "all" else 0o664)
    elif os.geteuid() == 0:
        os.chown(file, 4242, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 4242)


@pytest.mark.parametrize(
    ("kind", "how"), [("*.nbi", "owner"), ("*.nbi", "group"), ("*.nbc", "all")]
)
def test_what_another_user_can_have_written_is_not_run(
    cache: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch, kind: str, how: str,
) -> None:  # fmt: skip
    """Row 78: in a cache that several users write to, each ran what any of them had put there."""
    first, second = compiled_twice()
    assert first(3.0) == 1.5
    (file,) = cache.rglob(kind)
    content = pickle.dumps(Attack(tmp_path / "attacked"))
    file.write_bytes(content if kind == "*.nbi" else hashlib.sha256(content).digest() + content)
    give_away(file, how, monkeypatch)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert second(3.0) == 1.5
    assert not (tmp_path / "attacked").exists()
    (said,) = [each.message for each in caplog.records if "cannot be trusted" in each.message]
    assert "another user" in said


def test_no_umask_makes_kernels_that_others_can_write(cache: Path) -> None:
    before = os.umask(0o002)
    try:
        first, second = compiled_twice()
        assert [first(3.0), second(3.0)] == [1.5, 1.5]
    finally:
        os.umask(before)
    assert {oct(file.stat().st_mode & 0o777) for file in cache.rglob("*.nb?")} == {"0o644"}
    assert sum(second.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]


@pytest.mark.skipif(os.geteuid() != 0, reason="needs files of root")
def test_what_root_has_compiled_is_read_by_all(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path))
    assert compiled_twice()[0](3.0) == 1.5
    monkeypatch.setattr(os, "geteuid", lambda: 4242)
    other = compiled_twice()[0]
    assert other(3.0) == 1.5
    assert not list((tmp_path / "kernels-4242").rglob("*.nb?")), "it was not compiled again"


def test_code_that_was_not_kept_is_not_mistaken_for_older_code_of_other_types(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compiled_twice()[0](3.0) == 1.5
    locator = next(each for each in vars(caching) if "UserProvided" in each)  # numba renamed it
    monkeypatch.setattr(getattr(caching, locator), "get_source_stamp", lambda _: "again")
    first, second = compiled_twice()
    with monkeypatch.context() as full_disk:
        refuse = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
        full_disk.setattr(IndexDataCacheFile, "_save_data", refuse)
        assert first(3) == 1.5
    assert second(3) == 1.5
    assert not second.stats.cache_hits  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("kind", "damage"), [("*.nbi", cut), ("*.nbc", cut), ("*.nbc", lambda file: flip(file, -40))]
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


def test_a_cache_that_cannot_be_written_is_said_once(
    cache: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 61: a full disk was a raw OSError."""
    refuse = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr(IndexDataCacheFile, "_open_for_write", refuse)
    with caplog.at_level(logging.WARNING, "swarmdata"):
        assert [each(3.0) for each in compiled_twice()] == [1.5, 1.5]
    (said,) = [each.message for each in caplog.records if "cannot be kept" in each.message]
    assert "No space left on device" in said
    assert "SWARMDATA_CACHE" in said


def test_a_kernel_that_fails_lets_others_compile_it_and_leaves_the_collector_as_it_was(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @kernel
    def fail(x: float) -> float:
        return x.no_such_attribute  # type: ignore[attr-defined]

    usual, meanwhile = gc.get_threshold(), list[int]()
    monkeypatch.setattr(PROGRESS, "begin", lambda: meanwhile.append(gc.get_threshold()[0]))
    monkeypatch.setattr(PROGRESS, "end", lambda module: None)
    with pytest.raises(Exception, match="no_such_attribute"):
        fail(1.0)
    assert not [turn for turn in kernel_cache._turns if "fail" in turn]
    assert min(meanwhile) > usual[0]
    assert gc.get_threshold() == usual


def test_where_no_lock_can_be_made_every_process_compiles(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Mock(side_effect=OSError(errno.EIO, "the disk is broken"))
    monkeypatch.setattr(fcntl, "flock", broken)
    assert [each(3.0) for each in compiled_twice()] == [1.5, 1.5]


def test_one_does_not_wait_for_ever(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that compiles may have been stopped."""
    held = Mock(side_effect=BlockingIOError(errno.EAGAIN, "held by another process"))
    monkeypatch.setattr(fcntl, "flock", held)
    monkeypatch.setattr(kernel_cache, "MAX_WAIT", 0.2)
    assert compiled_twice()[0](3.0) == 1.5


def test_locks_of_kernels_go(cache: Path) -> None:
    first, second = compiled_twice()
    assert [first(3.0), second(3.0)] == [1.5, 1.5]
    assert not list(cache.rglob("*.lock"))
