"""Static hosts: a real web server over a published folder."""

from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff
from tests.hub.remotes.conftest import ID
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.static_host import StaticHost, _Handler


@pytest.fixture
def remote(host: StaticHost, backoff: Backoff) -> WebRemote:
    return WebRemote(host.url, backoff=backoff)


@pytest.mark.parametrize(("ranges", "times"), [(True, 2), (False, 2), (True, 12)])
def test_a_cut_file_goes_on_where_it_ended(
    remote: WebRemote, host: StaticHost, dataset: Path, tmp_path: Path, ranges: bool, times: int
) -> None:
    """Attempts count from the last that brought bytes."""
    host.ranges = ranges
    host.faults.append(Fault("GET .*observations/c", cut=1_000, times=times))
    release = Release(ID, f"{remote.address}/{ID}")
    file = next(dataset.glob("data.zarr/observations/c.*"))
    name = str(file.relative_to(dataset))

    remote.read(release, name, tmp_path / "out", file.stat().st_size)

    assert (tmp_path / "out").read_bytes() == file.read_bytes()
    assert len([line for line in host.log if "observations/c" in line]) == times + 1
    assert not (tmp_path / "out.part").exists()


@pytest.mark.parametrize("ranges", [True, False])
@pytest.mark.parametrize("there", [b"", b"wrong", b"x" * 100_000])
def test_leftovers_of_an_earlier_attempt_do_no_harm(
    remote: WebRemote, host: StaticHost, dataset: Path, tmp_path: Path, there: bytes, ranges: bool
) -> None:
    """At worst the content is wrong, which the caller finds, and the second time it is right."""
    host.ranges = ranges
    release = Release(ID, f"{remote.address}/{ID}")
    expected = (dataset / "recipe.json").read_bytes()
    (tmp_path / "out.part").write_bytes(there)
    remote.read(release, "recipe.json", tmp_path / "out", len(expected))
    assert (tmp_path / "out").stat().st_size == len(expected)
    remote.read(release, "recipe.json", tmp_path / "out", len(expected))
    assert (tmp_path / "out").read_bytes() == expected


def test_waits_as_long_as_the_server_asks(host: StaticHost) -> None:
    waits: list[float] = []
    patient = WebRemote(host.url, backoff=Backoff(attempts=4, sleep=waits.append))
    host.faults.append(Fault("manifest", 429, {"Retry-After": "7"}, times=1))
    host.faults.append(Fault("manifest", 503, {"Retry-After": "Sat, 21 Nov 2026"}, times=1))
    host.faults.append(Fault("manifest", 503, {"Retry-After": "86400"}, times=1))
    assert patient.find(ID) is not None
    assert waits == [7.0, 2.0, 30.0]


def test_what_a_server_says_controls_no_terminal(
    remote: WebRemote, host: StaticHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 80: the reason of its answer is shortened, on one line, and escaped; its cause too.

    It is not asked again.
    """
    reason = "no\x1b[2J\x1b]0;title\x07\x9b31m\u202e" + "x" * 5_000
    monkeypatch.setitem(_Handler.responses, 403, (reason.encode().decode("latin-1"), ""))
    host.faults.append(Fault("manifest", 403))
    with pytest.raises(HubError, match="answered HTTP 403 no") as caught:
        remote.find(ID)
    for error in (caught.value, caught.value.__cause__):
        assert str(error).isprintable()
        assert len(str(error)) < 500
    assert len(host.log) == 1


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"garbage", "not JSON"),
        (b"[" * 10_000, "not JSON"),
        (b"[]", "no list of names"),
        (b'{"ids": [1]}', "no list of names"),
        (b'{"ids": ["../../etc-x-v0"]}', "not ids of datasets"),
        (b'{"ids": ["coop_nav-a-v0", "coop_nav-a-v0"]}', "listed twice"),
    ],
)
def test_an_index_that_cannot_be_used(
    remote: WebRemote, published: Path, content: bytes, problem: str
) -> None:
    (published / "index.json").write_bytes(content)
    with pytest.raises(HubError, match=problem):
        remote.ids()


def test_without_an_index(remote: WebRemote, published: Path) -> None:
    (published / "index.json").unlink()
    with pytest.raises(HubError, match="datasets cannot be listed"):
        remote.ids()
    assert remote.find(ID) is not None
