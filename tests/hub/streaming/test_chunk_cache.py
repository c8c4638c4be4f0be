"""Chunks on the disk: the bound, which of them go, and how often files are looked at."""

import os
from pathlib import Path

import pytest

from swarmdata.hub.streaming.chunk_cache import SCANS, ChunkCache

BOUND, SIZE = 8_000, 100


def kept(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*.chunk"))


def test_the_bound_holds_after_every_write(tmp_path: Path) -> None:
    cache = ChunkCache(tmp_path, BOUND)
    for k in range(200):
        cache.write(f"a/{k}", bytes(SIZE + k % 50))
        assert kept(tmp_path) <= BOUND
    assert kept(tmp_path) > BOUND * (1 - 2 / SCANS)
    assert cache.read("a/199") == bytes(SIZE + 199 % 50)
    assert cache.read("a/0") is None


def test_what_was_read_last_stays(tmp_path: Path) -> None:
    cache = ChunkCache(tmp_path, BOUND)
    for k in range(200):
        cache.write(f"a/{k}", bytes(SIZE))
        os.utime(tmp_path / f"a/{k}.chunk", ns=(k, k))
        assert cache.read("a/0") == bytes(SIZE)


def test_files_are_looked_at_now_and_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looks, walk = 0, os.walk

    def counted(folder: Path) -> object:
        nonlocal looks
        looks += 1
        return walk(folder)

    monkeypatch.setattr(os, "walk", counted)
    cache = ChunkCache(tmp_path, BOUND)
    n_chunks = 3 * BOUND // SIZE
    for k in range(n_chunks):
        cache.write(f"a/{k}", bytes(SIZE))
    assert 3 * SCANS * 0.8 <= looks <= 3 * SCANS * 1.3


@pytest.mark.slow
def test_processes_share_the_bound(tmp_path: Path) -> None:
    caches = [ChunkCache(tmp_path, BOUND) for _ in range(3)]
    for k in range(300):
        caches[k % 3].write(f"a/{k}", bytes(SIZE))
        assert kept(tmp_path) <= BOUND * (1 + 3 / SCANS)


def test_a_chunk_above_the_bound_is_not_kept(tmp_path: Path) -> None:
    cache = ChunkCache(tmp_path, SIZE)
    cache.write("a/0", bytes(SIZE))
    cache.write("a/1", bytes(SIZE + 1))
    assert kept(tmp_path) == SIZE
    cache.write("a/2", bytes(SIZE))
    assert cache.read("a/0") is None
    assert cache.read("a/2") == bytes(SIZE)
    cache.forget("a/2")
    assert cache.read("a/2") is None


def test_what_cannot_be_kept_is_said_once_and_what_is_there_is_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ChunkCache(tmp_path, BOUND).write("a/0", b"content")
    (tmp_path / "b").write_text("where a folder belongs")
    cache = ChunkCache(tmp_path, BOUND)
    cache.write("b/0", b"content")
    cache.write("b/1", b"content")
    cache.forget("b/0")
    assert caplog.text.count("are not kept") == 1
    assert (cache.read("b/0"), cache.read("a/0")) == (None, b"content")
