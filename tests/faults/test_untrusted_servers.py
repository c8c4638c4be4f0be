"""Servers that lie, change while they are read, or keep things to themselves."""

import contextlib
import shutil
from pathlib import Path
from typing import Any

import pytest
from fsspec.implementations.memory import MemoryFileSystem

from swarmdata.errors import HubError
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.repair import examine
from swarmdata.hub.catalog.request import request_of_address
from swarmdata.hub.catalog.sources import Remotes, obtain
from swarmdata.hub.remotes.hosts.buckets import BucketRemote
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Remote
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.pull_dataset import pull
from tests.hub.remotes.conftest import ID, NAME, NEXT, is_pulled
from tests.hub.remotes.faults import Fault, FaultyHandler
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.hub.remotes.static_host import StaticHost
from tests.support.pairs import slow
from tests.support.tiny import TINY, Shelf

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


@pytest.mark.usefixtures("one_process")
def test_a_card_of_a_remote_is_not_believed(tmp_path: Path, tiny: Path) -> None:
    """Row 79: after a pull it is what the data give, however large and hostile theirs was."""
    shelf = Shelf(tmp_path / "shelf", tiny)
    theirs = tmp_path / "shelf" / TINY.id
    (theirs / "card.md").write_bytes(b"\x1b[2J# 100 % success\n![](http://127.0.0.1:9/x.png)\n")
    with (theirs / "references.json").open("wb") as file:
        file.truncate(65 << 20)
    found = obtain(request_of_address(f"{shelf.address}/{TINY.id}"), Remotes(progress=False))
    assert (found.folder / "card.md").read_bytes() == (tiny / "card.md").read_bytes()
    assert examine(found.folder) == ()
    assert load(found.folder).card == (tiny / "card.md").read_text()


def test_a_public_bucket_may_keep_its_list_and_its_cards(
    host: StaticHost, dataset: Path, tmp_path: Path, backoff: Backoff
) -> None:
    """Row 79: it answers 403 for what is absent; what the manifest lists is all that is needed."""
    found = WebRemote(host.url, backoff=backoff)
    host.faults.append(Fault("card.md|references.json|index.json", 403))
    there = found.find(ID)
    assert there is not None
    assert is_pulled(pull(found, there, tmp_path / ID, progress=False), dataset)
    with pytest.raises(HubError, match=r"HTTP 403.*for what they lack"):
        found.ids()


def test_a_history_that_is_rewritten_meanwhile(
    hub: LoopbackHub, remote: HubRemote, dataset: Path, tmp_path: Path
) -> None:
    """Row 82: a commit that is gone is one error, and nothing of it is visible."""
    release = remote.publish(dataset, ID)
    repository = hub.repositories[NAME]
    del repository.commits[repository.tags["v0"]]
    with pytest.raises(HubError, match="HTTP 404"):
        pull(remote, release, tmp_path / ID, progress=False)
    assert not (tmp_path / ID).exists()


@pytest.mark.parametrize(
    "tag",
    ["/../../../../../evil", *slow("", "a\\b", "\x1b[2J", "x" * 4_000, "e3b0c442", ".", "\u00fc")],
)
def test_etags_that_lie(
    hub: LoopbackHub,
    remote: HubRemote,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    tag: str,
) -> None:
    """Row 82: no name of a file comes from one; the right bytes arrive, or one error."""
    release = remote.publish(dataset, ID)
    send = FaultyHandler.send_header

    def lie(self: FaultyHandler, name: str, value: str) -> None:
        is_tag = name in ("ETag", "X-Linked-Etag")
        send(self, name, f'"{tag.encode().decode("latin-1")}"' if is_tag else value)

    monkeypatch.setattr(FaultyHandler, "send_header", lie)
    place = tmp_path / "deep" / "er"
    with contextlib.suppress(HubError):
        assert is_pulled(pull(remote, release, place / ID, progress=False), dataset)
    assert list(tmp_path.rglob("*evil*")) == []


def pushing(kind: str, hub: LoopbackHub, folder: Path, backoff: Backoff) -> tuple[Remote, Remote]:
    """A remote that publishes, and another one of the same place."""
    if kind == "hub":
        return HubRemote("hf://org", backoff=backoff), HubRemote("hf://org", backoff=backoff)
    address = f"memory://{folder.name}/prefix" if kind == "bucket" else f"file://{folder}"
    make: Any = BucketRemote if kind == "bucket" else FolderRemote
    return make(address), make(address)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["folder", *slow("bucket", "hub")])
def test_a_pull_during_a_push(
    hub: LoopbackHub,
    dataset: Path,
    successor: Path,
    tmp_path: Path,
    backoff: Backoff,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
) -> None:
    """Row 82: whoever asks meanwhile gets the version before, and of the new one all or nothing."""
    (tmp_path / "host").mkdir()
    pusher, reader = pushing(kind, hub, tmp_path / "host", backoff)
    pusher.publish(dataset, ID)
    seen: list[bool] = []
    is_asking = False

    def ask() -> None:
        """What others see now."""
        nonlocal is_asking
        if is_asking or len(seen) > 30:
            return
        is_asking = True
        try:
            release = reader.find(NEXT)
            seen.append(release is not None)
            before = reader.find(ID)
            assert before is not None
            place = tmp_path / f"seen-{len(seen)}"
            if len(seen) % 8 == 1:
                assert is_pulled(pull(reader, before, place / ID, progress=False), dataset)
            if release is not None:
                assert is_pulled(pull(reader, release, place / NEXT, progress=False), successor)
        finally:
            is_asking = False

    def asked_before(function: Any) -> Any:
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            ask()
            return function(*args, **kwargs)

        return wrapped

    with monkeypatch.context() as patch:
        if kind == "hub":
            patch.setattr(hub, "fault_of", asked_before(hub.fault_of))
        elif kind == "bucket":
            for name in ("put_file", "pipe_file"):
                patch.setattr(MemoryFileSystem, name, asked_before(getattr(MemoryFileSystem, name)))
        else:
            patch.setattr(shutil, "copyfile", asked_before(shutil.copyfile))
        pusher.publish(successor, NEXT)
    assert seen
    assert not seen[0]
    assert reader.find(NEXT) is not None
