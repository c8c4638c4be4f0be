"""ChunkCache: chunks of arrays on the local disk, in bounded space."""

import logging
import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from swarmdata.runtime.atomic import TEMPORARY_PREFIX, write_file

_LOG = logging.getLogger("swarmdata")

SUFFIX = ".chunk"  # of the files of chunks

SCANS = 16  # how often all files are looked at while as many bytes are written as the bound allows


class ChunkCache:
    """Chunks in files of their own; those that were not read for longest are deleted first.

    Several processes may share a folder; each may exceed the bound by a part in `SCANS`. Contents
    are for the caller to check. The bound of 0 bytes keeps none. Where nothing can be written, what
    is there is read, and no more is kept.
    """

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        self._lock, self._room = threading.Lock(), 0  # bytes to write before the next look
        self._is_written = True

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the folder, which processes may share."""
        return ChunkCache, (self._folder, self._most_bytes)

    def read(self, key: str) -> bytes | None:
        """The content of a chunk, None where it is not there."""
        if not self._most_bytes:
            return None  # what other streams keep is none of this one's
        path = self._path(key)
        try:
            content = path.read_bytes()
        except OSError:  # never there, or deleted meanwhile
            return None
        with suppress(OSError):
            os.utime(path)
        return content

    def write(self, key: str, content: bytes) -> None:
        """Keeps a chunk of a path such as `<digest>/actions/3`, and deletes others if need be."""
        if len(content) > self._most_bytes or not self._is_written:
            return
        path = self._path(key)
        try:
            with self._lock:
                self._room -= len(content)
                if self._room < 0:
                    self._room = self._make_room(len(content))
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, content)
        except OSError as error:
            self._is_written = False
            _LOG.warning("streamed chunks are not kept in %s any more: %s", self._folder, error)

    def forget(self, key: str) -> None:
        with suppress(OSError):
            self._path(key).unlink()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}{SUFFIX}"

    def _make_room(self, n_bytes: int) -> int:
        """Deletes files until so many bytes fit; returns how many more do before the next look."""
        found = []
        for folder, inner, names in os.walk(self._folder):  # passes over folders that vanish
            inner[:] = [name for name in inner if not name.startswith(TEMPORARY_PREFIX)]
            for path in (Path(folder, name) for name in names if name.endswith(SUFFIX)):
                try:
                    status = path.stat()
                except FileNotFoundError:  # another process deleted it
                    continue
                found.append((status.st_mtime_ns, status.st_size, path))
        total = sum(size for _, size, _ in found)
        limit, room = self._most_bytes - n_bytes, self._most_bytes // SCANS
        for _, size, path in sorted(found) if total > limit else ():
            if total <= limit - room:
                break
            path.unlink(missing_ok=True)
            total -= size
        return min(room, limit - total)
