"""A small dataset with a card, remotes that do not wait, and servers on this machine."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.pace import Meter
from swarmdata.hub.remotes.release_files import SIDE_FILES
from swarmdata.testing.synthetic import RELEASE_CARD, write_release
from tests.hub.remotes.faults import Clock
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.hub.remotes.static_host import StaticHost
from tests.support.tiny import contents

ID, NEXT = "coop_nav-synthetic-v0", "coop_nav-synthetic-v1"
ARRAY = "data.zarr/observations/c.0.0.0"
NAME = "org/coop_nav-synthetic"  # on a Hub
TOKEN = "hf_" + "s3cret" * 6


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished dataset; nobody may change it."""
    return write_release(tmp_path_factory.mktemp("published") / ID, [30, 10, 70, 40, 20], ID)


@pytest.fixture(scope="session")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another dataset of the same id."""
    return write_release(tmp_path_factory.mktemp("other") / ID, [30, 10, 71, 40, 20], ID)


@pytest.fixture(scope="session")
def successor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The next version."""
    return write_release(tmp_path_factory.mktemp("next") / NEXT, [30, 10, 72, 40, 20], NEXT)


@pytest.fixture
def published(dataset: Path, tmp_path: Path) -> Path:
    """A folder in which the dataset is published."""
    root = tmp_path / "host"
    root.mkdir()
    FolderRemote(root.as_uri()).publish(dataset, ID)
    return root


@pytest.fixture
def host(published: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[StaticHost]:
    """A web server over that folder."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    with StaticHost(published) as server:
        yield server


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """What goes with a dataset: the README, whose tags a Hub finds it by."""
    folder = tmp_path / "beside"
    (folder / "more").mkdir(parents=True)
    (folder / "README.md").write_text(RELEASE_CARD)
    (folder / "more/table.parquet").write_bytes(b"PAR1")
    return folder


@pytest.fixture
def backoff() -> Backoff:
    """Three attempts without waiting."""
    return Backoff(attempts=3, sleep=lambda seconds: None)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """What remotes measure the pace by; give it to a server, too, whose pauses advance it."""
    found = Clock()
    monkeypatch.setattr(Meter.__init__, "__defaults__", (found,))
    return found


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The client's own waits between attempts take hardly any time."""
    sleep = time.sleep
    monkeypatch.setattr(time, "sleep", lambda seconds: sleep(min(seconds, 0.01)))


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, impatient: None) -> Iterator[LoopbackHub]:
    """A hub whose large files go through LFS, and the environment to reach it."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_DISABLE_XET", True)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    with LoopbackHub() as server:
        monkeypatch.setenv("HF_ENDPOINT", server.url)
        yield server


@pytest.fixture
def remote(hub: LoopbackHub, backoff: Backoff) -> HubRemote:
    """The organization `org` of the hub."""
    return HubRemote("hf://org", backoff=backoff)


def same_files(one: Path, two: Path) -> bool:
    """Whether two folders hold the same bytes under the same names."""
    return contents(one) == contents(two)


def is_pulled(folder: Path, published: Path) -> bool:
    """Whether a folder has the dataset's own files, and none that the manifest does not list."""
    own = contents(published)
    return contents(folder) == {name: own[name] for name in own.keys() - set(SIDE_FILES)}
