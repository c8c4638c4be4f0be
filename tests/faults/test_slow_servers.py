"""Servers that give a byte now and then: left in time for the next source, and for Ctrl-C."""

import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.catalog.request import request_of_recipe
from swarmdata.hub.catalog.sources import Remotes, RemoteSkippedWarning, obtain
from swarmdata.hub.remotes.hosts.buckets import BucketRemote
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.pull_dataset import pull
from tests.hub.remotes.conftest import ARRAY, ID, is_pulled
from tests.hub.remotes.faults import Clock, Fault, FaultyServer
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.hub.remotes.static_host import StaticHost
from tests.support.at_once import Forked
from tests.support.pairs import slow
from tests.support.tiny import TINY

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


def slow_body(pattern: str) -> Fault:
    return Fault(pattern, drip=1, pause=0.3)


def slow_headers(pattern: str) -> Fault:
    return Fault(pattern, trickle=0.3)


@pytest.fixture
def one_file_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock that a slow file advances is that of all files."""
    monkeypatch.setattr("swarmdata.hub.remotes.pull_dataset.N_WORKERS", 1)


@pytest.mark.parametrize("fault", [slow_headers("GET"), *slow(Fault("GET", trickle=60.0))])
def test_a_deadline_on_headers(
    host: StaticHost, clock: Clock, backoff: Backoff, fault: Fault
) -> None:
    """Row 59: a byte of the headers now and then, or none."""
    host.clock, host.faults = clock, [fault]
    with pytest.raises(HubError, match=r"did not answer within 30 s"):
        WebRemote(host.url, backoff=backoff).find(ID)


@pytest.mark.slow
@pytest.mark.usefixtures("one_file_at_a_time")
def test_a_least_rate_of_bodies(
    host: StaticHost, clock: Clock, backoff: Backoff, dataset: Path, tmp_path: Path
) -> None:
    """Row 59: of the manifest, of arrays; what has arrived is kept, and the rest fetched later."""
    remote, host.clock = WebRemote(host.url, backoff=backoff), clock
    release = Release(ID, f"{host.url}/{ID}")
    for file in ("manifest.json", ARRAY):
        host.faults = [slow_body(f"GET .*{file}")]
        with pytest.raises(HubError, match="fewer than the least rate of 1024 bytes/s"):
            pull(remote, release, tmp_path / ID, progress=False)
        assert not (tmp_path / ID).exists()
    host.faults = []
    assert is_pulled(pull(remote, release, tmp_path / ID, progress=False), dataset)


@pytest.mark.usefixtures("one_file_at_a_time")
def test_the_next_source_is_asked(
    tmp_path: Path, tiny: Path, hub: LoopbackHub, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 59: `load` goes on to the next remote, and says why."""
    defaults = Backoff.__init__.__defaults__ or ()
    monkeypatch.setattr(Backoff.__init__, "__defaults__", (*defaults[:-1], lambda seconds: None))
    monkeypatch.setenv("SWARMDATA_LEAST_RATE", "1e3")
    root = tmp_path / "host"
    root.mkdir()
    FolderRemote(f"file://{root}").publish(tiny, TINY.id)
    with StaticHost(root) as slow, StaticHost(root) as good:
        slow.clock, slow.faults = clock, [slow_body(f"GET .*{ARRAY}")]
        with pytest.warns(RemoteSkippedWarning, match="fewer than the least rate of 1000 "):
            found = obtain(
                request_of_recipe(TINY, tmp_path / "d" / TINY.id),
                Remotes([slow.url, good.url], progress=False),
            )
    assert found.source == f"{good.url}/{TINY.id}"


@pytest.mark.slow
def test_a_slow_bucket_is_left(
    tmp_path: Path, dataset: Path, clock: Clock, backoff: Backoff, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 59: its client is left alone where it hangs; so is asking."""
    remote = BucketRemote("memory://slow/prefix", backoff=backoff)
    over = threading.Event()
    remote.publish(dataset, ID)
    release = remote.find(ID)
    assert release is not None

    def drip(source: str, target: str) -> None:
        with Path(target).open("wb", buffering=0) as file:
            while not over.wait(0.01):
                file.write(b"x")
                clock.now += 1.0

    def hang(path: str) -> None:
        clock.now += 100.0
        over.wait(60.0)

    monkeypatch.setattr(remote._files, "get_file", drip)
    with pytest.raises(HubError, match="fewer than the least rate"):
        remote.read(release, "recipe.json", tmp_path / "x", 10**6)
    monkeypatch.setattr(remote._files, "info", hang)
    with pytest.raises(HubError, match=r"did not answer within 30 s"):
        remote.find(ID)
    over.set()


@pytest.mark.slow
def test_a_slow_hub_is_left(
    hub: LoopbackHub, clock: Clock, dataset: Path, backoff: Backoff, tmp_path: Path, beside: Path
) -> None:
    """Row 59: the same of `hf://`."""
    remote = HubRemote("hf://org", backoff=backoff)
    release = remote.publish(dataset, ID, beside)
    hub.clock, hub.faults = clock, [Fault("GET .*/revision/", trickle=1.0)]
    with pytest.raises(HubError, match=r"did not answer within 30 s"):
        remote.find(ID)
    hub.faults = [slow_body("GET .*/resolve/|GET /_lfs")]
    with pytest.raises(HubError, match="fewer than the least rate"):
        HubRemote("hf://org", backoff=backoff).read(release, "recipe.json", tmp_path / "x", 10**6)


START_SECONDS = 300  # for a command to ask a server on a busy machine


def interrupted(server: FaultyServer, *arguments: str) -> tuple[int | None, str]:
    """Runs a command, presses Ctrl-C while the server lets it wait; exit code and words.

    The command is as patient as the server is slow, so it ends by Ctrl-C or not at all.
    """
    patience = {"SWARMDATA_ANSWER_SECONDS": "1e6", "SWARMDATA_RATE_SECONDS": "1e6"}
    running = Forked(*arguments, variables=patience)
    assert server.pausing.wait(START_SECONDS)
    running.send(signal.SIGINT)
    code, _, words = running.end()
    return code, words


@pytest.mark.slow
@pytest.mark.parametrize(("file", "fault"), [(ARRAY, slow_body), ("manifest.json", slow_headers)])
def test_ctrl_c_ends_a_pull_from_a_slow_server(
    host: StaticHost, tmp_path: Path, file: str, fault: Callable[[str], Fault]
) -> None:
    """Row 60: wherever it hangs, with one line; `test_pace.py` has the seconds."""
    host.faults = [fault(f"GET .*{file}")]
    code, words = interrupted(
        host, "pull", ID, "--from", host.url, "--out", str(tmp_path / "d" / ID)
    )
    assert code == 130
    assert "Traceback" not in words
    assert "Run the same command again" in words


@pytest.mark.slow
@pytest.mark.parametrize("file", ["/revision/", "/resolve/"])
def test_ctrl_c_ends_a_pull_from_a_slow_hub(
    hub: LoopbackHub, dataset: Path, backoff: Backoff, tmp_path: Path, file: str
) -> None:
    """Row 60: the same of `hf://`, whose client cannot be interrupted."""
    HubRemote("hf://org", backoff=backoff).publish(dataset, ID)
    hub.faults = [slow_body(f"GET .*{file}")]
    code, words = interrupted(
        hub, "pull", ID, "--from", "hf://org", "--out", str(tmp_path / "d" / ID)
    )
    assert (code, "Traceback" in words) == (130, False), words
