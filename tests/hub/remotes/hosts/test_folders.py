"""Folders on a disk: published in one rename, read with limits."""

import shutil
from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.interface import Release
from tests.hub.remotes.conftest import ID
from tests.support.tiny import abandoned


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "with space"
    folder.mkdir()
    return folder


@pytest.fixture
def remote(root: Path) -> FolderRemote:
    return FolderRemote(f"file://{str(root).replace(' ', '%20')}")


def test_an_interrupted_push_is_invisible(
    remote: FolderRemote, root: Path, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied: list[str] = []
    copy = shutil.copyfile

    def copy_some(source: Path, target: Path) -> None:
        copied.append(str(source))
        if len(copied) > 10:
            raise OSError(28, "No space left on device")
        copy(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", copy_some)
        with pytest.raises(HubError, match="no space is left"):
            remote.publish(dataset, ID)
    assert remote.ids() == ()
    assert list(root.iterdir()) == []

    abandoned(root / ID)
    (root / ".tmp-notes").mkdir()
    assert remote.find(remote.publish(dataset, ID).id) is not None
    left = {path.name for path in root.iterdir()}
    assert left == {".tmp-notes", "index.json", ID}


def test_a_link_that_leads_out_is_not_read(
    remote: FolderRemote, root: Path, dataset: Path, tmp_path: Path
) -> None:
    release = remote.publish(dataset, ID)
    (root / ID / "link").symlink_to("/etc/hostname")
    with pytest.raises(HubError, match="leads out of"):
        remote.read(release, "link", tmp_path / "x", 10_000)
    assert not (tmp_path / "x").exists()


def test_an_unmounted_folder_is_not_an_empty_one(tmp_path: Path) -> None:
    remote = FolderRemote(f"file://{tmp_path}/gone")
    for ask in (lambda: remote.find(ID), remote.ids):
        with pytest.raises(HubError, match="mount what it is on"):
            ask()
    with pytest.raises(HubError, match="mount what it is on"):
        remote.read(Release(ID, "file:///gone"), "x", tmp_path / "x", 1)


def test_a_folder_that_may_not_be_read_is_a_failed_remote(
    remote: FolderRemote, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    release = remote.publish(dataset, ID)

    def refuse(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_file", refuse)  # the superuser may read everything
    for ask in (lambda: remote.find(ID), remote.ids):
        with pytest.raises(HubError, match="cannot be read: Permission denied"):
            ask()
    with pytest.raises(HubError, match="cannot be read: Permission denied"):
        remote.read(release, "manifest.json", tmp_path / "x", 10_000)
