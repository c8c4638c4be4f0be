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


def test_what_the_gate_passes_is_sent_if_it_is_a_dataset(tmp_path: Path, dataset: Path) -> None:
    remote = FolderRemote(f"file://{tmp_path}")
    assert push(dataset, remote, lambda folder: ()).id == ID
    (tmp_path / "ds").mkdir()
    with pytest.raises(DatasetNotFoundError):
        push(tmp_path / "ds", remote, lambda folder: ())
