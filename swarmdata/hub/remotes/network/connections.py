"""HTTP connections that are never slower than a pace, and that do not lead into private networks.

A remote with a public address may only redirect to public ones: not to this machine's own ports, a
router, or where a cloud hands out credentials.
"""

import contextlib
import http.client
import io
import socket
from collections.abc import Iterator
from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network
from typing import Any
from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import (
    HTTPHandler,
    HTTPRedirectHandler,
    HTTPSHandler,
    OpenerDirector,
    Request,
    build_opener,
)

from swarmdata.errors import HubError, quoted
from swarmdata.hub.remotes.network.backoff import SLICE_SECONDS, check_stop
from swarmdata.hub.remotes.network.pace import Meter, Pace

_TRANSLATED = ip_network("64:ff9b::/96")
"""IPv6 addresses with an IPv4 address in their last 32 bits (RFC 6052)."""

_METADATA = frozenset({ip_address("168.63.129.16")})
"""Where a cloud tells a machine about itself, though the address is a public one (Azure)."""


def resolve(host: str, port: int) -> list[str]:
    """IP addresses of a host, in the order in which they are tried."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(each[4][0]) for each in found))


def connect(address: str, port: int, timeout: float) -> socket.socket:
    """A connected socket."""
    return socket.create_connection((address, port), timeout)


def is_private(address: str) -> bool:
    """Whether an address of IPv4 or IPv6, perhaps with a zone, is none of the public internet."""
    found = ip_address(address.partition("%")[0])
    if isinstance(found, IPv6Address):
        inner = found.ipv4_mapped or found.sixtofour
        if inner is None and found in _TRANSLATED:
            inner = IPv4Address(int(found) & 0xFFFFFFFF)
        if inner is not None:
            return is_private(str(inner))
    return not found.is_global or found.is_multicast or found in _METADATA


def opener(pace: Pace) -> OpenerDirector:
    """Returns what opens URLs; `opened` uses it."""
    return build_opener(_Redirects(), _Http(pace), _Https(pace))


@contextlib.contextmanager
def opened(
    opener: OpenerDirector, url: str, headers: dict[str, str], timeout: float
) -> Iterator[http.client.HTTPResponse]:
    """Asks for a URL; the answer is read at the opener's pace."""
    try:
        response = opener.open(Request(url, headers=headers), timeout=timeout)
    except ValueError as error:
        raise HubError(
            f"{url} redirects to an address that is none: {quoted(error)}. Tell whoever publishes "
            "there."
        ) from error
    with response:
        yield response


class _PublicRequest(Request):
    """A request that may only go to public addresses."""


class _Redirects(HTTPRedirectHandler):
    """Follows redirects of HTTP, but not out of TLS, and not into private networks."""

    def redirect_request(
        self, req: Request, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Request | None:
        try:
            return self._checked(req, fp, code, msg, headers, newurl)
        except BaseException:
            fp.close()  # urllib only does after a redirect that it follows
            raise

    def _checked(
        self, req: Request, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Request | None:
        old, new = urlsplit(req.full_url), urlsplit(newurl)
        if new.scheme not in ("http", "https") or (old.scheme, new.scheme) == ("https", "http"):
            target = quoted(f"{new.scheme}://{new.hostname}")
            raise HubError(
                f"{req.full_url} redirects to {target}, expected another "
                f"{old.scheme}:// address. It is not followed; tell whoever publishes there."
            )
        made = super().redirect_request(req, fp, code, msg, headers, newurl)
        if made is None:
            return None
        if not isinstance(req, _PublicRequest):
            ours = self._addresses(old, req)
            if ours and all(map(is_private, ours)):
                return made
        _check_public(new.hostname or "", self._addresses(new, req))
        return _PublicRequest(made.full_url, headers=dict(made.headers), unverifiable=True)

    def _addresses(self, url: Any, request: Request) -> list[str]:
        """Of a host; none where a proxy knows the names, and this machine does not."""
        port = url.port or (443 if url.scheme == "https" else 80)
        try:
            return resolve(url.hostname or "", port)
        except OSError as error:
            if _has_proxy(request):
                return []
            raise URLError(error) from error


def _has_proxy(request: Request) -> bool:
    return request.has_proxy() or getattr(request, "_tunnel_host", None) is not None


def _check_public(host: str, addresses: list[str]) -> None:
    for address in addresses:
        if is_private(address):
            raise HubError(
                f"a redirect leads to {quoted(host)} at {address}, which is not an address of the "
                "public internet. The remote itself has a public one, so it is not followed; tell "
                "whoever publishes there."
            )


class _Paced:
    """Makes connections for the handlers of `urllib.request`."""

    def __init__(self, pace: Pace) -> None:
        super().__init__()
        self._pace = pace

    def _factory(self, kind: type[http.client.HTTPConnection], request: Request) -> Any:
        """What makes a connection for a request; a proxy's own address is never checked."""
        is_public = isinstance(request, _PublicRequest) and not _has_proxy(request)
        meter = Meter(self._pace, request.full_url)

        def dial(address: tuple[str, int], timeout: float, source: object = None) -> socket.socket:
            return self._dial(*address, meter, is_public=is_public)

        def make(host: str, **options: Any) -> http.client.HTTPConnection:
            connection = kind(host, **options)
            connection._create_connection = dial  # type: ignore[attr-defined]
            connection.response_class = lambda sock, *rest, **named: _PacedResponse(  # type: ignore[assignment]
                sock, meter, *rest, **named
            )
            return connection

        return make

    def _dial(self, host: str, port: int, meter: Meter, *, is_public: bool) -> socket.socket:
        """Connects to one of a host's addresses, which were checked and are not asked for again."""
        addresses = resolve(host, port)
        if is_public:
            _check_public(host, addresses)
        failure: OSError = OSError(f"{host} has no address")
        for address in addresses:
            check_stop()
            try:
                return connect(address, port, meter.seconds_left())
            except OSError as error:
                failure = error
        raise failure


class _Http(_Paced, HTTPHandler):
    def http_open(self, req: Request) -> http.client.HTTPResponse:
        return self.do_open(self._factory(http.client.HTTPConnection, req), req)


class _Https(_Paced, HTTPSHandler):
    def https_open(self, req: Request) -> http.client.HTTPResponse:
        return self.do_open(self._factory(http.client.HTTPSConnection, req), req)


class _PacedResponse(http.client.HTTPResponse):
    """An answer whose headers and body are read at a pace."""

    def __init__(self, sock: socket.socket, meter: Meter, *rest: Any, **named: Any) -> None:
        super().__init__(sock, *rest, **named)
        self.fp: Any
        self.fp.close()
        self.fp = io.BufferedReader(_PacedSocket(sock, meter))
        self._meter = meter

    def begin(self) -> None:
        super().begin()
        self._meter.begin_body()


class _PacedSocket(io.RawIOBase):
    """Reads from a socket in slices, and looks in between whether to go on."""

    def __init__(self, sock: socket.socket, meter: Meter) -> None:
        self._sock, self._meter = sock, meter
        self._open = sock.makefile("rb", buffering=0)  # keeps the socket open until `close`

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while True:
            check_stop()
            self._sock.settimeout(min(SLICE_SECONDS, self._meter.seconds_left()))
            try:
                n_bytes = self._sock.recv_into(buffer)
            except TimeoutError:
                continue
            self._meter.count(n_bytes)
            return n_bytes

    def close(self) -> None:
        if not self.closed:
            self._open.close()
        super().close()
