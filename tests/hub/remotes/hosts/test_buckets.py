"""S3 through moto's server, and what every object store must do through fsspec's in memory."""

import sys
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest
import s3fs
from fsspec.implementations.memory import MemoryFileSystem

from swarmdata.errors import ConflictError, HubError, MissingExtraError
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.hosts.buckets import CLAIM_FILE, BucketRemote
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.pull_dataset import pull
from tests.hub.remotes.conftest import ID, is_pulled
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.object_store import ObjectStore

memory = MemoryFileSystem()


@pytest.fixture
def remote(backoff: Backoff) -> BucketRemote:
    return BucketRemote(f"memory://{uuid4().hex}/prefix", backoff=backoff)


@pytest.fixture(scope="module")
def server() -> Iterator[ObjectStore]:
    with ObjectStore() as server:
        s3fs.S3FileSystem(**server.options).makedirs("bucket", exist_ok=True)
        yield server
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.fixture
def store(server: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> ObjectStore:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    server.log.clear()
    server.faults.clear()
    return server


def objects(remote: BucketRemote) -> set[str]:
    root = remote.address.removeprefix("memory:/")
    return {path.removeprefix(f"{root}/") for path in memory.find(root)}


@pytest.mark.slow
def test_s3_with_the_environment_of_its_tools(
    store: ObjectStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", store.url)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "testing")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "testing")
    assert open_remote("s3://bucket/prefix").find(ID) is None
    assert store.log


@pytest.mark.slow
def test_s3_survives_faults(
    store: ObjectStore, backoff: Backoff, dataset: Path, tmp_path: Path, impatient: None
) -> None:
    """Codes, cuts and lost answers on the way in and out."""
    remote = BucketRemote("s3://bucket/p", backoff=backoff, options=store.options)
    store.faults += [
        Fault("PUT .*states", 503, times=1),
        Fault("PUT .*actions", lose=True, times=1),
        Fault("PUT .*rewards", 500, times=2),
    ]
    release = remote.publish(dataset, ID)
    store.faults[:] = [
        Fault("GET .*manifest.json", 503, times=1),
        Fault("GET .*actions/c", cut=100, times=1),
        Fault("GET .*observations/c", corrupt=True, times=1),
    ]
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)
    assert all(fault.times == 0 for fault in store.faults)


def test_without_s3fs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swarmdata\[s3\]'"):
        open_remote("s3://bucket/prefix")


def test_a_dataset_is_visible_from_its_manifest_on(
    remote: BucketRemote, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []
    put = MemoryFileSystem.put_file

    def put_some(self: MemoryFileSystem, source: str, target: str) -> None:
        sent.append(target)
        if len(sent) >= 20:
            raise RuntimeError("out of order")
        assert remote.find(ID) is None
        put(self, source, target)

    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "put_file", put_some)
        with pytest.raises(HubError, match="failed 3 times: RuntimeError: out of order"):
            remote.publish(dataset, ID)
    assert remote.find(ID) is None
    assert remote.ids() == ()
    assert f"{ID}/{CLAIM_FILE}" in objects(remote)

    release = remote.publish(dataset, ID)

    assert remote.find(ID) == release
    files = {str(path.relative_to(dataset)) for path in dataset.rglob("*") if path.is_file()}
    assert objects(remote) == {"index.json", *(f"{ID}/{file}" for file in files)}


def test_large_files_are_not_sent_twice(
    remote: BucketRemote, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmdata.hub.remotes.hosts.buckets.LARGE_FILE_BYTES", 2_000)
    create = MemoryFileSystem.pipe_file

    def fail_on_manifest(
        self: MemoryFileSystem, path: str, value: bytes, mode: str = "overwrite"
    ) -> None:
        if path.endswith("manifest.json"):
            raise ConnectionError("gone")
        create(self, path, value, mode=mode)

    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "pipe_file", fail_on_manifest)
        with pytest.raises(HubError, match="gone"):
            remote.publish(dataset, ID)

    sent: list[str] = []
    put = MemoryFileSystem.put_file

    def note(self: MemoryFileSystem, source: str, target: str) -> None:
        sent.append(target)
        put(self, source, target)

    monkeypatch.setattr(MemoryFileSystem, "put_file", note)
    remote.publish(dataset, ID)
    assert sent
    assert not any("observations/c" in path for path in sent)


def test_two_pushers_do_not_mix(remote: BucketRemote, dataset: Path) -> None:
    claim = f"{remote.address.removeprefix('memory:/')}/{ID}/{CLAIM_FILE}"
    memory.pipe_file(claim, b"0" * 64)
    with pytest.raises(ConflictError, match=r"delete memory://.*\.pushing and push again"):
        remote.publish(dataset, ID)
    assert objects(remote) == {f"{ID}/{CLAIM_FILE}"}


def test_missing_credentials_are_not_tried_again(
    remote: BucketRemote, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def refuse(self: MemoryFileSystem, path: str) -> None:
        asked.append(path)
        raise PermissionError("Access Denied")

    monkeypatch.setattr(MemoryFileSystem, "info", refuse)
    with pytest.raises(HubError, match="credentials"):
        remote.find(ID)
    assert len(asked) == 1
