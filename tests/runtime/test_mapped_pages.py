"""Pages of mapped files are given back, and read again as they are."""

import mmap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmdata.runtime import mapped_pages
from swarmdata.runtime.mapped_pages import (
    MappedReads,
    gather_rows,
    mapping_of,
    release_pages,
    take_rows,
)

ROWS, COLUMNS = 8192, 256


@pytest.fixture
def mapped(tmp_path: Path) -> NDArray[np.float32]:
    """8 MiB of a file, all of whose pages are resident."""
    values = np.arange(ROWS * COLUMNS, dtype=np.float32).reshape(ROWS, COLUMNS)
    values.tofile(tmp_path / "values")
    with (tmp_path / "values").open("rb") as file:
        content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    array = np.frombuffer(content, dtype=np.float32).reshape(ROWS, COLUMNS)
    assert array.sum() > 0
    return array


def resident(array: NDArray[np.float32]) -> int:
    """Bytes of the file that count as memory of this process."""
    address = array.__array_interface__["data"][0]
    found, is_it = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        head = line.split()[0]
        if "-" in head and not head.endswith(":"):
            low, high = (int(each, 16) for each in head.split("-"))
            is_it = low <= address < high
        elif is_it and head == "Rss:":
            found = 1024 * int(line.split()[1])
    return found


def test_pages_are_given_back_and_read_again(mapped: NDArray[np.float32]) -> None:
    before = mapped.sum(dtype=np.float64)
    assert resident(mapped) == mapped.nbytes
    release_pages(mapped)
    assert resident(mapped) == 0
    assert mapped.sum(dtype=np.float64) == before


def test_only_the_pages_of_a_view_are_given_back(mapped: NDArray[np.float32]) -> None:
    """Whole huge pages are given back, so a view in a half leaves the other half."""
    release_pages(mapped[: ROWS // 4])
    assert mapped.nbytes // 2 <= resident(mapped) <= mapped.nbytes * 3 // 4
    assert mapped[: ROWS // 2].any()
    release_pages(mapped[::-2, 3:7][: ROWS // 4])
    assert 0 < resident(mapped) <= mapped.nbytes // 2


def test_arrays_in_memory_stay(mapped: NDArray[np.float32]) -> None:
    held = mapped.copy()
    release_pages(held)
    release_pages(np.zeros((0, 3)))
    assert np.array_equal(held, mapped)
    assert mapping_of(held) is None
    assert mapping_of(mapped[3:, ::2]) is not None


@pytest.mark.slow
def test_pages_are_given_back_on_the_way(
    mapped: NDArray[np.float32], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mapped_pages, "READ_BYTES", 4 << 20)
    reads, most = MappedReads([mapped]), 0
    release_pages(mapped)
    total = 0.0
    for first in range(0, ROWS, 512):  # each look at the memory reads a long file
        rows = mapped[first : first + 512]
        total += rows.sum(dtype=np.float64)
        reads.add(rows)
        most = max(most, resident(mapped))
    assert total == np.arange(ROWS * COLUMNS, dtype=np.float64).sum()
    assert most <= 4 << 20
    reads.release()
    assert resident(mapped) == 0


def test_rows_are_taken_in_any_order_and_their_pages_given_back(
    mapped: NDArray[np.float32], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mapped_pages, "READ_BYTES", 4 << 20)
    rng = np.random.default_rng(0)
    expected = np.array(mapped)
    for rows in (
        np.arange(ROWS),
        np.arange(5, ROWS, 100),
        rng.permutation(ROWS),
        rng.integers(9, size=0),
    ):
        assert np.array_equal(take_rows(mapped, rows), expected[rows])
        assert not len(rows) or resident(mapped) == 0
    assert np.array_equal(take_rows(expected, np.array([3, 3])), expected[[3, 3]])


@pytest.mark.parametrize("read", [take_rows, gather_rows])
def test_only_the_rows_that_are_asked_for_are_copied(
    read: Callable[[NDArray[Any], NDArray[np.int64]], NDArray[Any]],
) -> None:
    endless = np.broadcast_to(np.arange(6.0), (1 << 40, 6))[:, 1:3]
    rows = np.array([1 << 39, 7])
    assert read(endless, rows).tolist() == [[1.0, 2.0], [1.0, 2.0]]
