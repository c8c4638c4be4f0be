"""The `https` remote against a real web server: TLS, byte ranges, limits, redirects."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.hub.remotes.pull_dataset import pull
from swarmdata.store.scratch import scratch_folder
from tests.hub.remotes import nginx
from tests.hub.remotes.conftest import ARRAY, ID, is_pulled
from tests.hub.remotes.nginx import Nginx

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(nginx.missing() is not None, reason=nginx.missing() or ""),
]

Serve = Callable[..., Nginx]


@pytest.fixture
def serve(published: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Serve]:
    """Starts servers of a published folder, whose authority is trusted."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    running: list[Nginx] = []

    def start(extra: str = "", *, is_trusted: bool = True) -> Nginx:
        server = Nginx(published, tmp_path / f"nginx-{len(running)}", extra)
        if is_trusted:
            monkeypatch.setenv("SSL_CERT_FILE", str(server.authority))
        running.append(server.__enter__())
        return server

    yield start
    for server in running:
        server.__exit__()


def remote(server: Nginx, pace: Pace | None = None) -> WebRemote:
    return WebRemote(server.url, backoff=Backoff(attempts=2, sleep=lambda _: None), pace=pace)


def test_round_trip(serve: Serve, dataset: Path, tmp_path: Path) -> None:
    """Rows 69, 70: asked, listed, fetched over TLS, within which redirects are followed."""
    server = serve()
    found = remote(server)
    release = found.find(ID)
    assert release is not None
    assert found.ids() == (ID,)
    assert found.find("coop_nav-nothing-v0") is None
    assert is_pulled(pull(found, release, tmp_path / ID, progress=False), dataset)
    backoff = Backoff(attempts=1)
    assert WebRemote(f"{server.url}/moved", backoff=backoff).find(ID) is not None
    with pytest.raises(HubError, match="expected another https:// address"):
        WebRemote(f"{server.url}/plain", backoff=backoff).find(ID)


def test_a_pull_that_was_cut_goes_on_with_ranges(
    serve: Serve, dataset: Path, tmp_path: Path
) -> None:
    """Row 69: with 206 for the rest, as the server's log says, and not from the beginning."""
    server = serve()
    scratch = scratch_folder(tmp_path / ID, "pull")
    begun = scratch / f"{ARRAY}.arriving.part"
    found = remote(server)
    (scratch / "incoming").mkdir(parents=True)
    shutil.copyfile(dataset / "manifest.json", scratch / "incoming" / "manifest.json")
    begun.parent.mkdir(parents=True)
    begun.write_bytes((dataset / ARRAY).read_bytes()[:1000])
    release = Release(ID, f"{server.url}/{ID}")
    assert is_pulled(pull(found, release, tmp_path / ID, progress=False), dataset)
    (line,) = [each for each in server.log() if ARRAY in each]
    left = (dataset / ARRAY).stat().st_size - 1000
    assert f" 206 {left} " in line


def test_an_unknown_authority_is_refused(serve: Serve) -> None:
    """Row 69: with the certificate's problem, and without another attempt."""
    with pytest.raises(HubError, match="has no valid certificate"):
        remote(serve(is_trusted=False)).find(ID)


def test_a_server_with_a_limit_of_one_byte_a_second_is_left(serve: Serve, tmp_path: Path) -> None:
    """Row 69: `limit_rate 1`, over TLS; what is quicker is not."""
    server = serve("limit_rate 1;")
    with pytest.raises(HubError, match=r"fewer than the least rate|did not answer within"):
        pull(
            remote(server, pace=Pace(2.0, 1000.0, 1.0)),
            Release(ID, f"{server.url}/{ID}"),
            tmp_path / ID,
            progress=False,
        )
