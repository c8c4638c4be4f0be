"""Redirects: followed in public and in private, never from the one into the other."""

import socket
from pathlib import Path

import pytest

from swarmdata.errors import HubError
from swarmdata.hub.remotes.addresses import parse_address
from swarmdata.hub.remotes.hosts.web import WebRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network import connections
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.connections import is_private
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.hub.remotes.pull_dataset import pull
from tests.hub.remotes.conftest import ID, is_pulled
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.static_host import StaticHost

PUBLIC, OTHER_PUBLIC = "198.41.0.4", "2001:500:2::c"  # of root name servers: surely public


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1", "127.8.8.8", "10.1.2.3", "172.16.0.1", "172.31.255.255", "192.168.1.1",
        "169.254.169.254", "100.64.0.1", "100.100.100.200", "0.0.0.0", "255.255.255.255",
        "224.0.0.1", "168.63.129.16", "::1", "::", "fe80::1", "fe80::1%eth0", "fc00::1",
        "fd00:ec2::254", "ff02::1", "::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1",
        "64:ff9b::a9fe:a9fe", "2002:7f00:1::", "2002:c0a8:101::",
    ],
)  # fmt: skip
def test_private_addresses(address: str) -> None:
    assert is_private(address)


@pytest.mark.parametrize(
    "address", [PUBLIC, OTHER_PUBLIC, "8.8.8.8", "172.32.0.1", "::ffff:8.8.8.8", "64:ff9b::808:808"]
)
def test_public_addresses(address: str) -> None:
    assert not is_private(address)


class Names:
    """Names of this test, each a server on this machine, whatever its address is said to be."""

    def __init__(self, **addresses: list[str]) -> None:
        self.addresses = {name.replace("_", "."): found for name, found in addresses.items()}
        self.port = 0
        self.unknown: tuple[str, ...] = ()
        self.dialled: list[str] = []

    def resolve(self, host: str, port: int) -> list[str]:
        if host in self.unknown:
            raise socket.gaierror(-2, "Name or service not known")
        return self.addresses.get(host, [host])

    def connect(self, address: str, port: int, timeout: float) -> socket.socket:
        self.dialled.append(address)
        return socket.create_connection(("127.0.0.1", self.port), timeout)


@pytest.fixture
def names(host: StaticHost, monkeypatch: pytest.MonkeyPatch) -> Names:
    found = Names(
        data_example=[PUBLIC],
        mirror_example=[OTHER_PUBLIC],
        inside_example=["10.0.0.7"],
        sly_example=[PUBLIC, "127.0.0.1"],
        intranet_example=["192.168.0.9"],
    )
    found.port = host.server_port
    for name in ("resolve", "connect"):
        monkeypatch.setattr(connections, name, getattr(found, name))
    return found


def remote(address: str) -> WebRemote:
    return WebRemote(address, backoff=Backoff(attempts=1), pace=Pace(5.0, 100.0, 5.0))


def redirect(host: StaticHost, to: str) -> None:
    """The next request for a manifest is sent to another server."""
    place = {"Location": f"{to}/{ID}/manifest.json"}
    host.faults = [Fault("GET .*manifest", 302, place, times=1)]


def test_a_remote_at_an_address_of_ipv6(
    host: StaticHost, names: Names, dataset: Path, tmp_path: Path
) -> None:
    found = remote(parse_address(f"http://[2001:db8::7]:8080/{ID}").remote)
    release = found.find(ID)
    assert release == Release(ID, f"http://[2001:db8::7]:8080/{ID}")
    assert is_pulled(pull(found, release, tmp_path / ID, progress=False), dataset)
    assert set(names.dialled) == {"2001:db8::7"}


def test_a_public_remote_may_redirect_to_a_public_one(
    host: StaticHost, names: Names, dataset: Path, tmp_path: Path
) -> None:
    redirect(host, "http://mirror.example")
    found = remote("http://data.example")
    release = found.find(ID)
    assert release == Release(ID, f"http://data.example/{ID}")
    assert names.dialled == [PUBLIC, OTHER_PUBLIC]
    assert is_pulled(pull(found, release, tmp_path / ID, progress=False), dataset)


@pytest.mark.parametrize(
    "target",
    [
        "http://127.0.0.1", "http://169.254.169.254", "http://[::1]:8080", "http://[fd00:ec2::254]",
        "http://inside.example", "http://sly.example", "http://[::ffff:10.0.0.1]",
    ],
)  # fmt: skip
def test_a_public_remote_may_not_lead_into_a_private_network(
    host: StaticHost, names: Names, tmp_path: Path, target: str
) -> None:
    redirect(host, target)
    with pytest.raises(HubError, match="not an address of the public internet"):
        remote("http://data.example").find(ID)
    assert names.dialled == [PUBLIC], "nobody in there was asked"
    redirect(host, target)
    found, release = remote("http://data.example"), Release(ID, f"http://data.example/{ID}")
    with pytest.raises(HubError, match="not an address of the public internet"):
        pull(found, release, tmp_path / ID, progress=False)
    assert set(names.dialled) == {PUBLIC}
    assert not (tmp_path / ID).exists()


def test_nor_over_a_public_mirror(host: StaticHost, names: Names) -> None:
    to = f"{ID}/manifest.json"
    host.faults = [
        Fault("GET .*manifest", 302, {"Location": f"http://mirror.example/{to}"}, times=1),
        Fault("GET .*manifest", 302, {"Location": f"http://inside.example/{to}"}, times=1),
    ]
    with pytest.raises(HubError, match=r"leads to inside\.example at 10\.0\.0\.7"):
        remote("http://data.example").find(ID)
    assert names.dialled == [PUBLIC, OTHER_PUBLIC]


def test_nor_by_a_name_that_changes_between_the_check_and_the_connection(
    host: StaticHost, names: Names, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([[OTHER_PUBLIC], ["127.0.0.1"]])
    resolve = names.resolve

    def rebound(name: str, port: int) -> list[str]:
        return next(answers) if name == "mirror.example" else resolve(name, port)

    monkeypatch.setattr(connections, "resolve", rebound)
    redirect(host, "http://mirror.example")
    with pytest.raises(HubError, match=r"leads to mirror\.example at 127\.0\.0\.1"):
        remote("http://data.example").find(ID)
    assert names.dialled == [PUBLIC]


@pytest.mark.parametrize("target", ["http://inside.example", "http://data.example"])
def test_a_private_remote_may_redirect_where_it_likes(
    host: StaticHost, names: Names, target: str
) -> None:
    redirect(host, target)
    assert remote("http://intranet.example").find(ID) is not None
    assert len(names.dialled) == 2


@pytest.mark.parametrize(
    ("target", "start"),
    [("ftp://mirror.example", "http://data.example"), ("file:///etc", "http://data.example")],
)
def test_only_the_web_is_followed(host: StaticHost, names: Names, target: str, start: str) -> None:
    redirect(host, target)
    with pytest.raises(HubError):
        remote(start).find(ID)
    assert names.dialled == [PUBLIC]


def test_every_address_of_a_name_is_tried(names: Names, monkeypatch: pytest.MonkeyPatch) -> None:
    names.addresses["data.example"] = ["198.41.0.5", PUBLIC]
    connect = names.connect

    def some(address: str, port: int, timeout: float) -> socket.socket:
        if address != PUBLIC:
            raise ConnectionRefusedError
        return connect(address, port, timeout)

    monkeypatch.setattr(connections, "connect", some)
    found = remote("http://data.example")
    assert found.find(ID) is not None
    names.addresses["data.example"] = []
    with pytest.raises(HubError, match="no connection to"):
        found.find(ID)


@pytest.mark.parametrize("target", ["http://[::1", "http://mirror.example:99999", "http://:x"])
def test_a_redirect_to_no_address_is_one_error(host: StaticHost, names: Names, target: str) -> None:
    """Row 70: malformed addresses."""
    redirect(host, target)
    with pytest.raises(HubError, match="redirects to an address that is none"):
        remote("http://data.example").find(ID)


def test_a_redirect_to_an_unknown_name_is_one_error(host: StaticHost, names: Names) -> None:
    """Row 70: it may be known later."""
    names.unknown = ("nowhere.example",)
    redirect(host, "http://nowhere.example")
    with pytest.raises(HubError, match="Name or service not known"):
        remote("http://data.example").find(ID)


@pytest.fixture
def behind_a_proxy(host: StaticHost, names: Names, monkeypatch: pytest.MonkeyPatch) -> WebRemote:
    """A remote that is reached over a proxy, which alone knows the names."""
    for name in ("NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("http_proxy", f"http://me:s3cret@proxy.example:{host.server_port}")
    names.unknown = ("data.example", "mirror.example")
    names.addresses["proxy.example"] = ["10.0.0.9"]
    return remote("http://data.example")


def test_a_proxy_knows_the_names(host: StaticHost, names: Names, behind_a_proxy: WebRemote) -> None:
    """Row 70: its own address is private, and no redirect; what it is asked for is followed."""
    redirect(host, "http://mirror.example")
    assert behind_a_proxy.find(ID) is None, "this proxy has nothing"
    path = f"{ID}/manifest.json"
    assert host.log == [f"GET http://{name}.example/{path}" for name in ("data", "mirror")]
    assert names.dialled == ["10.0.0.9"] * 2


def test_the_password_of_a_proxy_is_sent_to_it_and_not_repeated(
    host: StaticHost, behind_a_proxy: WebRemote
) -> None:
    """Row 80: also where the proxy gives it away itself."""
    for fault in (
        Fault("GET", 407),
        Fault("GET", 302, {"Location": "http://me:s3cret@proxy.example:none/"}),
        Fault("GET", 302, {"Location": "ftp://me:s3cret@host/"}),
    ):
        host.faults = [fault]
        with pytest.raises(HubError) as caught:
            behind_a_proxy.find(ID)
        assert "s3cret" not in str(caught.value)


def test_a_proxy_is_not_sent_into_a_private_network(
    host: StaticHost, behind_a_proxy: WebRemote
) -> None:
    """Row 70: as far as the address says so itself."""
    redirect(host, "http://169.254.169.254")
    with pytest.raises(HubError, match="not an address of the public internet"):
        behind_a_proxy.find(ID)
    assert len(host.log) == 1
