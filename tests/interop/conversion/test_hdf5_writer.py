"""Our HDF5 files are those of h5py, and a failure to write is raised instead of a crash."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from swarmdata.interop.conversion.hdf5_writer import create_hdf5


def fill(file: h5py.File, check: Callable[[], None], n_blocks: int = 40) -> None:
    rows = file.create_dataset(
        "deep/rows", (0, 8), "f4", maxshape=(None, 8), chunks=(512, 8), fletcher32=True
    )
    for block in range(n_blocks):
        rows.resize(512 * (block + 1), axis=0)
        rows[512 * block :] = np.float32(block)
        check()
    file["text"] = "a note"


def test_what_is_written_is_read_by_h5py(tmp_path: Path) -> None:
    with create_hdf5(tmp_path / "x.hdf5") as opened:
        fill(*opened)
    with h5py.File(tmp_path / "x.hdf5") as file:
        np.testing.assert_array_equal(file["deep/rows"][:, 3], np.repeat(np.arange(40), 512))
        assert file["text"][()] == b"a note"
    with pytest.raises(FileExistsError), create_hdf5(tmp_path / "x.hdf5"):
        pass


@pytest.mark.parametrize("least", [0, 1, 3000, 20_000, 300_000, 600_000])
def test_a_failed_write_is_raised_wherever_it_happens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, least: int
) -> None:
    pwrite = os.pwrite

    def some(descriptor: int, content: bytes, position: int) -> int:
        if position + len(content) > least:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(descriptor, content, position)

    monkeypatch.setattr(os, "pwrite", some)
    with pytest.raises(OSError, match="No space left"), create_hdf5(tmp_path / "x") as opened:
        fill(*opened)


def test_what_fails_at_the_very_end_is_raised_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "ftruncate", refuse)

    def fill_then_fail() -> None:
        with create_hdf5(tmp_path / "x") as opened:
            fill(*opened, 1)
            monkeypatch.setattr(os, "pwrite", refuse)

    with pytest.raises(OSError, match="No space left"):
        fill_then_fail()


def test_the_umask_says_who_else_may_write_to_a_file(tmp_path: Path) -> None:
    before = os.umask(0o002)
    try:
        with create_hdf5(tmp_path / "x.hdf5") as opened:
            fill(*opened)
    finally:
        os.umask(before)
    assert (tmp_path / "x.hdf5").stat().st_mode & 0o777 == 0o664
