"""Faults that a test server injects into its answers."""

import re
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self


class Clock:
    """Seconds that pass only in the pauses of a slow server: no busy machine is too slow."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@dataclass
class Fault:
    """What happens to requests whose `METHOD /path` matches; seconds are of the server's clock."""

    pattern: str  # a regular expression, searched for
    status: int | None = None  # answered instead of the request being handled
    headers: dict[str, str] = field(default_factory=dict)  # of that answer
    cut: int | None = None  # bytes of the body after which the connection ends
    corrupt: bool = False  # whether one bit of the body is flipped; its length stays
    drip: int = 0  # bytes sent at a time
    pause: float = 0.0  # seconds after these
    trickle: float = 0.0  # seconds between two bytes of the status and the headers
    lose: bool = False  # whether the request is handled but its answer never sent
    skip: int = 0  # matching requests that are let through first
    times: int = 1_000_000  # matching requests that are hit after those

    def hits(self, request: str) -> bool:
        """Counts a request; whether the fault happens to it."""
        if not re.search(self.pattern, request):
            return False
        if self.skip:
            self.skip -= 1
            return False
        if self.times <= 0:
            return False
        self.times -= 1
        return True


class FaultyServer(ThreadingHTTPServer):
    """A server on 127.0.0.1 with a log of its requests and a list of faults to inject."""

    daemon_threads = True

    def __init__(self, handler: type[BaseHTTPRequestHandler]) -> None:
        super().__init__(("127.0.0.1", 0), handler)
        self.faults: list[Fault] = []
        self.log: list[str] = []
        self.clock: Clock | None = None  # of the client, which pauses advance; None: they are real
        self.pausing = threading.Event()  # set as soon as an answer has paused
        self._closing = threading.Event()
        self.lock = threading.RLock()
        poll = {"poll_interval": 0.01}  # s that `shutdown` waits
        self._thread = threading.Thread(target=self.serve_forever, kwargs=poll, daemon=True)

    @property
    def url(self) -> str:
        """Where it listens."""
        return f"http://127.0.0.1:{self.server_port}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._closing.set()
        self.shutdown()
        self.server_close()
        self._thread.join()

    def fault_of(self, request: str) -> Fault | None:
        """Logs a request and returns what shall happen to it."""
        with self.lock:
            self.log.append(request)
            return next((fault for fault in self.faults if fault.hits(request)), None)

    def pause(self, seconds: float) -> None:
        """Lets an answer wait, until the server ends at most; a clock goes 100 times as fast."""
        self.pausing.set()
        if self.clock is None:
            self._closing.wait(seconds)
            return
        while seconds > 0.0 and not self._closing.wait(min(seconds, 1.0) / 100.0):
            self.clock.now += min(seconds, 1.0)
            seconds -= 1.0

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is no error of a test."""


class FaultyHandler(BaseHTTPRequestHandler):
    """Answers requests; a subclass says with what."""

    protocol_version = "HTTP/1.1"
    server: FaultyServer
    fault: Fault | None = None

    def log_message(self, *args: Any) -> None:
        """Nothing on the terminal."""

    def answer(self) -> None:
        """Handles one request; for subclasses."""
        raise NotImplementedError

    def handle_request(self) -> None:
        self.fault = self.server.fault_of(f"{self.command} {self.path}")
        if self.fault is not None and self.fault.status is not None:
            self.read_body()
            self.send(self.fault.status, b'{"error": "injected"}', self.fault.headers)
        else:
            self.answer()

    do_GET = do_HEAD = do_POST = do_PUT = do_DELETE = handle_request  # noqa: N815  # http.server's

    def read_body(self) -> bytes:
        """The request's body."""
        length = self.headers.get("Content-Length")
        if length is not None:
            return self.rfile.read(int(length))
        body = b""
        if "chunked" in self.headers.get("Transfer-Encoding", ""):
            while size := int(self.rfile.readline().strip(), 16):
                body += self.rfile.read(size)
                self.rfile.readline()
            self.rfile.readline()
        return body

    def send(self, status: int, body: bytes = b"", headers: dict[str, str] | None = None) -> None:
        """Sends an answer, with the fault of this request."""
        fault = self.fault or Fault("")
        if fault.lose:
            self.hang_up()
            return
        self.send_response(status)
        every = {"Content-Type": "application/json", "Content-Length": str(len(body))}
        for name, value in {**every, **(headers or {})}.items():
            self.send_header(name, value)
        self._send_headers(fault.trickle)
        if self.command == "HEAD":
            return
        if fault.corrupt and body:
            middle = len(body) // 2
            body = body[:middle] + bytes([body[middle] ^ 1]) + body[middle + 1 :]
        if fault.cut is not None:
            self.wfile.write(body[: fault.cut])
            self.hang_up()
            return
        step = fault.drip or max(1, len(body))
        for start in range(0, len(body), step):
            self.wfile.write(body[start : start + step])
            if fault.drip:
                self.wfile.flush()
                self.server.pause(fault.pause)

    def _send_headers(self, seconds: float) -> None:
        """Ends the headers; with so many seconds between two of their bytes."""
        if seconds:
            buffer: list[bytes] = vars(self)["_headers_buffer"]  # of http.server
            for byte in b"".join(buffer):
                self.wfile.write(bytes([byte]))
                self.server.pause(seconds)
            buffer.clear()
        self.end_headers()

    def hang_up(self) -> None:
        """Ends the connection at once."""
        self.wfile.flush()
        self.close_connection = True
        self.connection.shutdown(2)

    def send_file(self, data: bytes, headers: dict[str, str], *, ranges: bool = True) -> None:
        """Sends a file, or the range of it that was asked for."""
        asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        every = {"Content-Type": "application/octet-stream", **headers}
        if asked is None or not ranges:
            self.send(200, data, {**every, "Content-Length": str(len(data))})
            return
        first, last = int(asked[1]), int(asked[2] or len(data) - 1)
        if first >= len(data):
            self.send(416, b"", {"Content-Range": f"bytes */{len(data)}"})
            return
        span = {"Content-Range": f"bytes {first}-{min(last, len(data) - 1)}/{len(data)}"}
        self.send(206, data[first : last + 1], {**every, **span})
