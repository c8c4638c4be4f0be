"""A web server over a folder that answers requests for byte ranges, in a process of its own.

    python -m tests.benchmarks.range_server FOLDER

The port is the first line that it prints. It keeps connections and reads only what is asked for.
"""

import re
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: "RangeServer"

    def do_GET(self) -> None:
        path = self.server.folder / self.path.lstrip("/")
        if not path.is_file():
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        size = path.stat().st_size
        asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        first, last = (int(asked[1]), int(asked[2] or size - 1)) if asked else (0, size - 1)
        last = min(last, size - 1)
        self.send_response(HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK)
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self.send_header("Content-Length", str(last - first + 1))
        self.end_headers()
        with path.open("rb") as file:
            if last >= first:
                self.connection.sendfile(file, first, last - first + 1)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing is logged."""


class RangeServer(ThreadingHTTPServer):
    """Serves the files of `folder` on the loopback interface."""

    daemon_threads = True

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.folder = folder


if __name__ == "__main__":
    with RangeServer(Path(sys.argv[1])) as server:
        print(server.server_address[1], flush=True)
        server.serve_forever()
