"""Static web hosts, `https://host/folder`: read only, resumed with byte ranges."""

import http.client
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from urllib.error import HTTPError, URLError
from urllib.parse import quote

from swarmdata.errors import AbsentFileError, HubError, quoted
from swarmdata.hub.remotes.hosts.id_index import INDEX_FILE, MAX_INDEX_BYTES, read_index
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff, TransientError, refuse_offline, seconds
from swarmdata.hub.remotes.network.connections import opened, opener
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.runtime.outside_names import split_id
from swarmdata.store.arrays.layout import MANIFEST

BLOCK_BYTES = 1 << 16  # bytes read at a time; what a lost connection has of one is fetched again

TRANSIENT_STATUS = frozenset((408, 425, 429, 500, 502, 503, 504))
"""HTTP answers that may be different the next time."""

Response = http.client.HTTPResponse


class WebRemote:
    """Datasets that a web server gives as plain files, such as a published `file://` folder."""

    def __init__(
        self, address: str, *, backoff: Backoff | None = None, pace: Pace | None = None
    ) -> None:
        self.address = address
        self._backoff = backoff or Backoff()
        self._pace = pace or Pace.from_environment()
        self._opener = opener(self._pace)

    def find(self, dataset_id: str) -> Release | None:
        split_id(dataset_id)
        url = f"{self.address}/{dataset_id}/{MANIFEST}"

        def is_there() -> bool:
            try:
                with self._open(url):
                    return True
            except AbsentFileError:
                return False

        found = self._backoff.run(f"asking {self.address} for {dataset_id}", is_there)
        return Release(dataset_id, f"{self.address}/{dataset_id}") if found else None

    def ids(self) -> tuple[str, ...]:
        def fetch() -> bytes:
            with self._open(f"{self.address}/{INDEX_FILE}") as response:
                content = response.read(MAX_INDEX_BYTES + 1)
                if response.length:
                    raise TransientError(f"the answer was cut, {response.length} bytes are missing")
                return content

        try:
            content = self._backoff.run(f"asking {self.address} for its datasets", fetch)
        except AbsentFileError as error:
            raise HubError(
                f"{self.address} has no {INDEX_FILE}, so its datasets cannot be listed. A dataset "
                "whose id you know can still be pulled."
            ) from error
        return read_index(content, self.address)

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        part = out.with_name(f"{out.name}.part")
        url = f"{release.address}/{quote(file)}"
        there = _size(part)
        while True:
            try:
                self._backoff.run(f"fetching {url}", lambda: self._download(url, part, size))
                break
            except HubError:  # attempts count from the last that brought bytes
                if (now := _size(part)) <= there:
                    raise
                there = now
        part.replace(out)

    def read_range(self, release: Release, file: str, first: int, size: int) -> bytes:
        url = f"{release.address}/{quote(file)}"

        def fetch() -> bytes:
            headers = {"Range": f"bytes={first}-{first + size - 1}"}
            try:
                with self._open(url, headers) as response:
                    if response.status != http.client.PARTIAL_CONTENT:
                        raise HubError(
                            f"{url} is on a server that gives whole files only (it ignores the "
                            "header Range), so nothing can be streamed from it. Load it without "
                            "stream=True."
                        )
                    if not _starts_at(response, first):
                        raise TransientError("the server sent another range than was asked for")
                    content = response.read(size)
            except _UnsatisfiableRangeError as error:
                raise HubError(f"{url} has less than {first + size:,} bytes.") from error
            if len(content) != size:
                raise TransientError(f"the answer was cut after {len(content)} of {size} bytes")
            return content

        return self._backoff.run(f"fetching {url}", fetch)

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        raise HubError(
            f"{self.address} is read only: plain web hosts take no files. Push to the file:// "
            "folder or the bucket that it serves."
        )

    def _download(self, url: str, part: Path, size: int) -> None:
        """Adds what is missing to `part`; a server that ignores ranges sends everything again."""
        there = _size(part)
        if there == size:
            return  # stopped between the last byte and the rename
        if there > size:
            part.unlink()
            there = 0
        headers = {"Range": f"bytes={there}-"} if there else {}
        try:
            with self._open(url, headers) as response:
                resumed = response.status == http.client.PARTIAL_CONTENT
                begin = there if resumed and _starts_at(response, there) else 0
                if resumed and begin != there:
                    raise TransientError("the server sent another range than was asked for")
                with part.open("ab" if begin else "wb") as file:
                    _copy(response, file, size - begin, url)
        except _UnsatisfiableRangeError as error:  # all of it was there, or the file has changed
            part.unlink()
            raise TransientError("the server refused to go on where it had ended") from error

    @contextmanager
    def _open(self, url: str, headers: dict[str, str] | None = None) -> Iterator[Response]:
        """Sends one request; failures of the connection and of the body become our errors."""
        refuse_offline(self.address)
        try:
            with opened(self._opener, url, headers or {}, self._pace.answer_seconds) as response:
                yield response
        except HTTPError as error:
            error.close()  # it is the answer, with an open connection
            raise _explained(error, url) from error
        except URLError as error:
            if isinstance(error.reason, HubError):
                raise error.reason from error
            if isinstance(error.reason, ssl.SSLCertVerificationError):
                raise HubError(
                    f"{url} has no valid certificate: {quoted(error.reason)}."
                ) from error
            raise TransientError(f"no connection to {url}: {quoted(error.reason)}") from error
        except (TimeoutError, ConnectionError, ssl.SSLError, http.client.HTTPException) as error:
            raise TransientError(
                f"the connection to {url} was lost: {quoted(repr(error))}"
            ) from error


class _UnsatisfiableRangeError(Exception):
    """HTTP 416."""


def _explained(error: HTTPError, url: str) -> Exception:
    if error.code in (404, 410):
        return AbsentFileError(f"there is no {url}.")
    if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
        return _UnsatisfiableRangeError()
    error.msg = quoted(error.reason)  # a traceback shows it too
    problem = f"{url} answered HTTP {error.code} {error.msg}"
    if error.code in TRANSIENT_STATUS:
        return TransientError(problem, seconds(error.headers.get("Retry-After")))
    more = "; buckets without a public list answer so for what they lack" * (error.code == 403)
    return HubError(f"{problem}. Look whether the address is right and open to you{more}.")


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


def _starts_at(response: Response, offset: int) -> bool:
    return (response.headers.get("Content-Range") or "").startswith(f"bytes {offset}-")


def _copy(response: Response, file: BinaryIO, limit: int, url: str) -> None:
    """Copies the body, at most `limit` bytes; a body that ends early is a transient failure."""
    left = limit
    while block := response.read(min(BLOCK_BYTES, left + 1)):
        left -= len(block)
        if left < 0:
            break
        file.write(block)
    if left < 0 or (response.length or 0) > left:
        raise HubError(
            f"{url} is larger than the {limit:,} bytes that were expected of it. It is not the "
            "file that the manifest lists; tell whoever publishes there."
        )
    if response.length:
        raise TransientError(f"the answer was cut, {response.length} bytes are missing")
