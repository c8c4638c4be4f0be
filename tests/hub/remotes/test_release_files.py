"""Nothing is sent that the gate refuses."""

from pathlib import Path

import pytest

from swarmdata.errors import DatasetNotFoundError, GateError
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.release_files import push
from tests.hub.remotes.conftest import ID


def test_every_reason_is_told(tmp_path: Path, dataset: Path) -> None:
    remote = FolderRemote(f"file://{tmp_path}")
    with pytest.raises(GateError, match=r"Nothing was sent:\n- too small\n- too old"):
        push(dataset, remote, lambda folder: ["too small", "too old"])
    assert list(tmp_path.iterdir()) == []


def test_through_the_gate(tmp_path: Path, dataset: Path) -> None:
    remote, asked = FolderRemote(f"file://{tmp_path}"), list[Path]()

    def gate(folder: Path) -> tuple[str, ...]:
        asked.append(folder)
        return ()

    assert push(dataset, remote, gate).id == ID
    assert asked == [dataset]


def test_an_unfinished_dataset(tmp_path: Path) -> None:
    (tmp_path / "ds").mkdir()
    with pytest.raises(DatasetNotFoundError):
        push(tmp_path / "ds", FolderRemote(f"file://{tmp_path}"), lambda folder: ())
