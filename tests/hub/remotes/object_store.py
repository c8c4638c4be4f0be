"""S3 on this machine: moto's server, and before it a server that injects faults."""

import http.client
from typing import Any, Self

from moto.server import ThreadedMotoServer

from tests.hub.remotes.faults import FaultyHandler, FaultyServer

_HOP = {"connection", "transfer-encoding", "content-length", "keep-alive", "date", "server"}


class _Handler(FaultyHandler):
    server: "ObjectStore"

    def answer(self) -> None:
        body = self.read_body()
        connection = http.client.HTTPConnection(*self.server.behind, timeout=300)
        headers = {key: value for key, value in self.headers.items() if key.lower() not in _HOP}
        connection.request(self.command, self.path, body, headers)
        response = connection.getresponse()
        content = response.read()
        kept = {key: value for key, value in response.getheaders() if key.lower() not in _HOP}
        if self.command == "HEAD":
            kept["Content-Length"] = response.headers.get("Content-Length", "0")
        connection.close()
        self.send(response.status, content, kept)


class ObjectStore(FaultyServer):
    """An empty S3 with one bucket, `bucket`."""

    def __init__(self) -> None:
        super().__init__(_Handler)
        self._moto = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        self.behind: tuple[str, int] = ("", 0)

    @property
    def options(self) -> dict[str, Any]:
        """What `BucketRemote` needs to reach it."""
        quick = {"connect_timeout": 5, "read_timeout": 20, "retries": {"max_attempts": 0}}
        secrets = {"key": "testing", "secret": "testing"}
        return {**secrets, "endpoint_url": self.url, "config_kwargs": quick}

    def __enter__(self) -> Self:
        self._moto.start()
        host, port = self._moto.get_host_and_port()
        self.behind = (host, port)
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._moto.stop()
