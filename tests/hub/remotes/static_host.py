"""A static web server over a folder, with faults; with or without byte ranges."""

from pathlib import Path

from tests.hub.remotes.faults import FaultyHandler, FaultyServer


class _Handler(FaultyHandler):
    server: "StaticHost"

    def answer(self) -> None:
        path = self.server.folder / self.path.lstrip("/")
        if path.is_file():
            self.send_file(path.read_bytes(), {}, ranges=self.server.ranges)
        else:
            self.send(404)


class StaticHost(FaultyServer):
    """Serves the files of `folder`."""

    def __init__(self, folder: Path, *, ranges: bool = True) -> None:
        super().__init__(_Handler)
        self.folder, self.ranges = folder, ranges
