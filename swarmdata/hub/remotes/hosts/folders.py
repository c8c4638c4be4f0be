"""A folder of datasets on a disk or a network share, `file:///folder`."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

from swarmdata.errors import AbsentFileError, BuildError, HubError
from swarmdata.hub.remotes.hosts.id_index import INDEX_FILE, index_bytes
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import LOCAL_ERRNOS
from swarmdata.hub.remotes.release_files import check_size, files_to_publish, version_taken
from swarmdata.runtime.atomic import new_folder, remove_leftovers, write_file
from swarmdata.runtime.locking import locked
from swarmdata.runtime.outside_names import ID_PATTERN, is_id, split_id
from swarmdata.store.arrays.layout import MANIFEST


class FolderRemote:
    """Datasets in one folder, each in a folder of its id; a static web server can serve it."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._root = Path(unquote(address.removeprefix("file://")))

    def find(self, dataset_id: str) -> Release | None:
        split_id(dataset_id)
        with self._reading():
            if not (self._root / dataset_id / MANIFEST).is_file():
                return None
        return Release(dataset_id, f"{self.address}/{dataset_id}")

    def ids(self) -> tuple[str, ...]:
        with self._reading():
            return tuple(
                sorted(
                    path.name
                    for path in self._root.iterdir()
                    if is_id(path.name) and (path / MANIFEST).is_file()
                )
            )

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        with self._reading():
            source = self._source(release, file)
            check_size(str(source), source.stat().st_size, size)
        part = out.with_name(f"{out.name}.part")
        try:
            shutil.copyfile(source, part)
        except OSError as error:
            if error.errno in LOCAL_ERRNOS:
                raise
            raise HubError(f"{source} cannot be copied to {out}: {error}.") from error
        part.replace(out)

    def read_range(self, release: Release, file: str, first: int, size: int) -> bytes:
        with self._reading():
            source = self._source(release, file)
            with source.open("rb") as stream:
                content = os.pread(stream.fileno(), size, first)
        if len(content) != size:
            raise HubError(f"{source} ends at byte {first + len(content)}, expected {first + size}")
        return content

    def _source(self, release: Release, file: str) -> Path:
        source = self._root / release.id / file
        if not source.is_file():
            raise AbsentFileError(f"{release.address} has no file {file!r}.")
        if not source.resolve().is_relative_to(self._root.resolve()):
            raise HubError(f"{source} leads out of {self._root}, it is not read.")
        return source

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        split_id(dataset_id)
        self._check_reachable()
        files = files_to_publish(folder, dataset_id, beside)
        target = self._root / dataset_id
        try:
            with locked(self._root / INDEX_FILE):
                remove_leftovers(self._root, INDEX_FILE, ID_PATTERN)
                if not target.exists():
                    with new_folder(target) as scratch:
                        for name, file in files.items():
                            (scratch / name).parent.mkdir(parents=True, exist_ok=True)
                            shutil.copyfile(file, scratch / name)
                elif not _is_same(target, folder):
                    raise version_taken(dataset_id, self.address)
                write_file(self._root / INDEX_FILE, index_bytes(self.ids()))
        except HubError:
            raise
        except (OSError, BuildError) as error:
            raise HubError(
                f"publishing {dataset_id} to {self.address} failed: {error}. Nothing of it is "
                "visible there; push again when the cause is gone."
            ) from error
        return Release(dataset_id, f"{self.address}/{dataset_id}")

    def part_files(self, folder: str) -> tuple[str, ...]:
        with self._reading():
            found = self._root / folder
            return tuple(sorted(p.name for p in found.iterdir())) if found.is_dir() else ()

    def send_part_file(self, folder: str, name: str, content: bytes) -> None:
        self._check_reachable()
        try:
            (self._root / folder).mkdir(exist_ok=True)
            write_file(self._root / folder / name, content)
        except OSError as error:
            raise HubError(f"sending {name} to {self.address}/{folder} failed: {error}.") from error

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Makes what the disk refuses a failure of this remote, so that the next one is asked."""
        try:
            self._check_reachable()
            yield
        except HubError:
            raise
        except OSError as error:
            raise HubError(
                f"{error.filename or self._root} of the remote {self.address} cannot be read: "
                f"{error.strerror}."
            ) from error

    def _check_reachable(self) -> None:
        if not self._root.is_dir():
            raise HubError(
                f"there is no folder {self._root}, which the remote {self.address} is. Make it, or "
                "mount what it is on."
            )


def _is_same(published: Path, folder: Path) -> bool:
    """Whether the published manifest is this one; it has the SHA-256 of every other file."""
    manifest = published / MANIFEST
    return manifest.is_file() and manifest.read_bytes() == (folder / MANIFEST).read_bytes()
