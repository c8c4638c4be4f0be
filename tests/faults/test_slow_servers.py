"""Servers that give a byte now and then: left in time for the next source, and for Ctrl-C."""
# ruff: noqa: F811  # fixtures of tests/hub/remotes are imported, and asked for by their names

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
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
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.hub.remotes.pull_dataset import pull
from tests.hub.remotes.conftest import (  # noqa: F401  # fixtures
    ID,
    TOKEN,
    backoff,
    beside,
    dataset,
    hub,
    impatient,
    same_files,
)
from tests.hub.remotes.faults import Fault, FaultyServer
from tests.hub.remotes.loopback_hub import LoopbackHub
from tests.hub.remotes.static_host import StaticHost
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY, make_tiny

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's

ARRAY = "data.zarr/observations/c.0.0.0"
HASTY = Pace(answer_seconds=0.8, least_rate=1000.0, window_seconds=0.8)
"""So that the tests do not wait."""

AT_MOST = 8.0
"""Seconds in which two attempts of a hasty remote have ended, on a slow machine."""


def slow_body(pattern: str) -> Fault:
    return Fault(pattern, drip=1, pause=0.3)


def slow_headers(pattern: str) -> Fault:
    return Fault(pattern, trickle=0.3)


@pytest.fixture
def host(dataset: Path, tmp_path: Path, hub: LoopbackHub) -> Iterator[StaticHost]:
    root = tmp_path / "host"
    root.mkdir()
    FolderRemote(f"file://{root}").publish(dataset, ID)
    with StaticHost(root) as server:
        yield server


@pytest.mark.parametrize("fault", [slow_headers("GET"), Fault("GET", stall=5.0, trickle=9.0)])
def test_a_deadline_on_headers(host: StaticHost, backoff: Backoff, fault: Fault) -> None:
    """Row 59: a byte of the headers now and then, or none."""
    host.faults = [fault]
    started = time.monotonic()
    with pytest.raises(HubError, match=r"did not answer within 0\.8 s"):
        WebRemote(host.url, backoff=backoff, pace=HASTY).find(ID)
    assert time.monotonic() - started < AT_MOST


def test_a_least_rate_of_bodies(
    host: StaticHost, backoff: Backoff, dataset: Path, tmp_path: Path
) -> None:
    """Row 59: of the manifest, of arrays; what has arrived is kept, and the rest fetched later."""
    remote = WebRemote(host.url, backoff=backoff, pace=HASTY)
    release = Release(ID, f"{host.url}/{ID}")
    for file in ("manifest.json", ARRAY):
        host.faults = [slow_body(f"GET .*{file}")]
        started = time.monotonic()
        with pytest.raises(HubError, match="fewer than the least rate of 1000 bytes/s"):
            pull(remote, release, tmp_path / ID, progress=False)
        assert time.monotonic() - started < AT_MOST
        assert not (tmp_path / ID).exists()
    host.faults = []
    assert same_files(pull(remote, release, tmp_path / ID, progress=False), dataset)


def test_the_next_source_is_asked(
    tmp_path: Path, hub: LoopbackHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 59: `load` goes on to the next remote, and says why."""
    use_one_process(monkeypatch)
    for name, value in {
        "ANSWER_SECONDS": "0.8",
        "LEAST_RATE": "1e3",
        "RATE_SECONDS": "0.8",
    }.items():
        monkeypatch.setenv(f"SWARMDATA_{name}", value)
    tiny = make_tiny(tmp_path / "source" / TINY.id)
    root = tmp_path / "host"
    root.mkdir()
    FolderRemote(f"file://{root}").publish(tiny, TINY.id)
    with StaticHost(root) as slow, StaticHost(root) as good:
        slow.faults = [slow_body(f"GET .*{ARRAY}")]
        with pytest.warns(RemoteSkippedWarning, match="fewer than the least rate"):
            found = obtain(
                request_of_recipe(TINY, tmp_path / "d" / TINY.id),
                Remotes([slow.url, good.url], progress=False),
            )
    assert found.source == f"{good.url}/{TINY.id}"


def test_a_slow_bucket_is_left(
    tmp_path: Path, dataset: Path, backoff: Backoff, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 59: its client is left alone where it hangs; so is asking."""
    remote = BucketRemote("memory://slow/prefix", backoff=backoff, pace=HASTY)
    remote.publish(dataset, ID)
    release = remote.find(ID)
    assert release is not None
    get = remote._files.get_file

    def drip(source: str, target: str) -> None:
        with Path(target).open("wb", buffering=0) as file:
            for _ in range(40):
                file.write(b"x")
                time.sleep(0.1)
        get(source, target)

    monkeypatch.setattr(remote._files, "get_file", drip)
    with pytest.raises(HubError, match="fewer than the least rate"):
        remote.read(release, "recipe.json", tmp_path / "x", 10**6)
    monkeypatch.setattr(remote._files, "info", lambda path: time.sleep(4.0))
    with pytest.raises(HubError, match=r"did not answer within 0\.8 s"):
        remote.find(ID)


@pytest.mark.slow
def test_a_slow_hub_is_left(
    hub: LoopbackHub, dataset: Path, backoff: Backoff, tmp_path: Path, beside: Path
) -> None:
    """Row 59: the same of `hf://`."""
    release = HubRemote("hf://org", backoff=backoff).publish(dataset, ID, beside)
    remote = HubRemote("hf://org", backoff=backoff, pace=HASTY)
    hub.faults = [slow_headers("GET .*/revision/")]
    with pytest.raises(HubError, match=r"did not answer within 0\.8 s"):
        remote.find(ID)
    hub.faults = [slow_body("GET .*/resolve/|GET /_lfs")]
    with pytest.raises(HubError, match="fewer than the least rate"):
        HubRemote("hf://org", backoff=backoff, pace=HASTY).read(
            release, "recipe.json", tmp_path / "x", 10**6
        )


def interrupted(server: FaultyServer, pattern: str, *arguments: str) -> tuple[int, float, str]:
    """Runs a command, presses Ctrl-C when it hangs; exit code, seconds that it took, its words."""
    script = f"import sys; sys.path[:] = {sys.path!r}; from swarmdata.cli.main import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not any(pattern in line for line in list(server.log)):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.5)
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, words = process.communicate(timeout=30)
    return process.returncode, time.monotonic() - started, words


@pytest.mark.parametrize("fault", [slow_body, slow_headers], ids=["body", "headers"])
@pytest.mark.parametrize("file", ["manifest.json", ARRAY])
def test_ctrl_c_ends_a_pull_from_a_slow_server(
    host: StaticHost, tmp_path: Path, fault: type[Fault], file: str
) -> None:
    """Row 60: within two seconds, wherever it hangs, with one line."""
    host.faults = [fault(f"GET .*{file}")]
    code, seconds, words = interrupted(
        host, file, "pull", ID, "--from", host.url, "--out", str(tmp_path / "d" / ID)
    )
    assert code == 130
    assert seconds < 2.0
    assert "Traceback" not in words
    assert "Run the same command again" in words


@pytest.mark.slow
@pytest.mark.parametrize("file", ["/revision/", "/resolve/"])
def test_ctrl_c_ends_a_pull_from_a_slow_hub(
    hub: LoopbackHub, dataset: Path, backoff: Backoff, tmp_path: Path, file: str
) -> None:
    """Row 60: the same of `hf://`, whose client cannot be interrupted."""
    HubRemote("hf://org", backoff=backoff).publish(dataset, ID)
    hub.log.clear()
    hub.faults = [slow_body(f"GET .*{file}")]
    code, seconds, words = interrupted(
        hub, file, "pull", ID, "--from", "hf://org", "--out", str(tmp_path / "d" / ID)
    )
    assert (code, "Traceback" in words) == (130, False), words
    assert seconds < 2.0
