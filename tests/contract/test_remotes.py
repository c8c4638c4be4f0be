"""Every kind of remote keeps the contract, and the suite notices every broken promise."""
# ruff: noqa: F811  # fixtures of tests/hub/remotes are imported, and asked for by their names

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar
from uuid import uuid4

import pytest
import s3fs

import swarmdata
from swarmdata.errors import HubError
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.hosts.buckets import BucketRemote
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.runtime import own_components
from swarmdata.runtime.own_components import GROUPS, REGISTERED_VARIABLE
from swarmdata.testing.remote_contract import check_remote
from swarmdata.testing.synthetic import write_release
from tests.hub.remotes.conftest import backoff, hub, impatient, remote  # noqa: F401  # fixtures
from tests.hub.remotes.object_store import ObjectStore
from tests.hub.remotes.static_host import StaticHost

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


@pytest.fixture(scope="module", autouse=True)
def written_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The suite's datasets are written once and copied."""
    root, kept = tmp_path_factory.mktemp("releases"), dict[str, Path]()

    def copied(out: Path, lengths: list[int], dataset_id: str) -> Path:
        key = f"{dataset_id} {lengths}"
        if key not in kept:
            kept[key] = write_release(root / str(len(kept)), lengths, dataset_id)
        return Path(shutil.copytree(kept[key], out))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swarmdata.testing.remote_contract.write_release", copied)
        yield


@pytest.fixture
def shelf(tmp_path: Path) -> FolderRemote:
    (tmp_path / "shelf").mkdir()
    return FolderRemote(f"file://{tmp_path}/shelf")


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "here").mkdir()
    return tmp_path / "here"


def test_folders(shelf: FolderRemote, here: Path) -> None:
    check_remote(shelf, here)


def test_object_stores(backoff: Backoff, here: Path) -> None:
    check_remote(BucketRemote(f"memory://{uuid4().hex}/prefix", backoff=backoff), here)


@pytest.mark.slow
def test_s3(backoff: Backoff, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    with ObjectStore() as server:
        s3fs.S3FileSystem(**server.options).makedirs("bucket", exist_ok=True)
        check_remote(BucketRemote("s3://bucket/a", backoff=backoff, options=server.options), here)
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.mark.slow
def test_the_hub(remote: HubRemote, here: Path) -> None:
    check_remote(remote, here)


def test_web_servers(
    shelf: FolderRemote, backoff: Backoff, tmp_path: Path, here: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    there = "coop_nav-there-v0"  # without any dataset, the folder would have no index
    shelf.publish(write_release(tmp_path / there, [30, 70], there), there)
    with StaticHost(tmp_path / "shelf") as server:
        web = WebRemote(server.url, backoff=backoff, pace=Pace(2.0, 100.0, 2.0))
        check_remote(web, here, writer=shelf)


class Own(FolderRemote):
    """A kind of remote that a user registers, of folders in `root`."""

    root: ClassVar[Path]

    def __init__(self, address: str) -> None:
        super().__init__(address.replace("shelf:/", self.root.as_uri()))


def test_a_registered_kind(tmp_path: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_components, "_here", {group: {} for group in GROUPS})
    monkeypatch.setenv(REGISTERED_VARIABLE, "{}")
    monkeypatch.setattr(Own, "root", tmp_path, raising=False)
    (tmp_path / "place").mkdir()
    swarmdata.register_remote("shelf", Own)
    swarmdata.check_remote(open_remote("shelf://place"), here)


class Truncates(FolderRemote):
    """Gives a part of a file instead of an error."""

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        super().read(release, file, out, 1 << 30)
        out.write_bytes(out.read_bytes()[:size])


class ChangesBytes(FolderRemote):
    """Gives other bytes than were published."""

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        super().read(release, file, out, size)
        out.write_bytes(out.read_bytes()[::-1])


class LeavesParts(FolderRemote):
    """Leaves what a failed read has got."""

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        try:
            super().read(release, file, out, size)
        except HubError:
            out.write_bytes(b"half")
            raise


class RaisesAnything(FolderRemote):
    """Raises an error of Python where a file is absent."""

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        if file == "nothing.txt":
            raise FileNotFoundError(file)
        super().read(release, file, out, size)


class Overwrites(FolderRemote):
    """Replaces what was published."""

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        shutil.rmtree(self._root / dataset_id, ignore_errors=True)
        return super().publish(folder, dataset_id, beside)


class DropsOthers(FolderRemote):
    """Keeps the newest version only."""

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        for each in self._root.glob("coop_nav-*"):
            if each.name != dataset_id:
                shutil.rmtree(each)
        return super().publish(folder, dataset_id, beside)


class ReadOnly(FolderRemote):
    """Publishes nothing, and says it with an error of Python's."""

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        raise NotImplementedError


def having(**methods: Callable[..., object]) -> type[FolderRemote]:
    """A kind of remote with other methods."""
    return type("Having", (FolderRemote,), methods)


@pytest.mark.parametrize(
    ("kind", "problem"),
    [
        (having(find=lambda self, name: None), "is None after it was published"),
        (having(find=lambda self, name: Release(name, self.address)), "it was never published"),
        (having(ids=lambda self: ()), "without the published"),
        (having(ids=lambda self: FolderRemote.ids(self) * 2), "not sorted or not unique"),
        (Truncates, "no HubError"),
        (ChangesBytes, "gave other bytes of"),
        (LeavesParts, "left a file at `out`"),
        (RaisesAnything, "no AbsentFileError"),
        (Overwrites, "no VersionTakenError"),
        (DropsOthers, "with two published versions"),
        (
            having(publish=lambda self, *files: FolderRemote.publish(self, *files[:2])),
            "published beside the dataset: AbsentFileError",
        ),
        (ReadOnly, "no SwarmdataError"),
    ],
)
def test_a_broken_promise_is_named(
    kind: type[FolderRemote], problem: str, tmp_path: Path, here: Path
) -> None:
    (tmp_path / "shelf").mkdir()
    with pytest.raises(AssertionError, match=problem):
        check_remote(kind(f"file://{tmp_path}/shelf"), here)


def test_a_remote_that_only_reads_refuses_to_publish(
    shelf: FolderRemote, tmp_path: Path, here: Path
) -> None:
    with pytest.raises(AssertionError, match="publish to a read only remote"):
        check_remote(ReadOnly(shelf.address), here, writer=shelf)
