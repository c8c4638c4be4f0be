"""Regular files: read whole, up to a bound, and nothing else."""

import os
from pathlib import Path

import pytest

from swarmdata.runtime.regular_files import read_regular


def test_a_file_is_read_up_to_the_bound(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_regular(tmp_path / "a", 5) == b"12345"
    with pytest.raises(OSError, match="has more than 4 bytes"):
        read_regular(tmp_path / "a", 4)
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "b", 5)


def test_links_are_followed_only_if_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    (tmp_path / "b").symlink_to("a")
    assert read_regular(tmp_path / "b", 5) == b"1"
    with pytest.raises(OSError, match="is a symbolic link, expected a regular file"):
        read_regular(tmp_path / "b", 5, follow_links=False)


def test_a_pipe_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="is a pipe"):
        read_regular(tmp_path / "pipe", 5)


def test_files_whose_size_is_not_known_are_bounded_too() -> None:
    with pytest.raises(OSError, match="has more than 10 bytes"):
        read_regular(Path("/proc/self/status"), 10)
