"""Object stores that fsspec knows, `s3://bucket/prefix` and its like."""

import hashlib
import uuid
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from swarmdata.errors import AbsentFileError, ConflictError, HubError, quoted
from swarmdata.hub.remotes.hosts.id_index import INDEX_FILE, index_bytes
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import LOCAL_ERRNOS, Backoff, TransientError
from swarmdata.hub.remotes.network.pace import Meter, Pace, watched
from swarmdata.hub.remotes.release_files import check_size, files_to_publish, version_taken
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.outside_names import is_id, split_id
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.manifest import MAX_MANIFEST_BYTES

T = TypeVar("T")

CLAIM_FILE = ".pushing"
"""Object beside a dataset's files while they are sent: the SHA-256 of the manifest to come, then
the large files that are there already, a line each."""

LARGE_FILE_BYTES = 1 << 20
"""Bytes from which on an interrupted push notes that a file has been sent."""

S3_OPTIONS: dict[str, Any] = {
    "config_kwargs": {"connect_timeout": 10, "read_timeout": 30, "retries": {"max_attempts": 2}}
}
"""Seconds without a byte before a connection counts as lost; `Backoff` does the waiting."""

FINAL_ERRORS = ("NoCredentialsError", "PartialCredentialsError", "ParamValidationError")
"""Errors of botocore that another attempt cannot change."""


class BucketRemote:
    """Datasets under a prefix of a bucket; visible from the moment their manifest is there.

    The first pusher of an id leaves a claim, so that no two mix their files; objects appear whole
    or not at all; the manifest is sent last and only where there is none.
    """

    def __init__(
        self, address: str, *, backoff: Backoff | None = None, options: dict[str, Any] | None = None
    ) -> None:
        self.address = address
        self._backoff = backoff or Backoff()
        self._pace = Pace.from_environment()
        scheme, _, self._root = address.partition("://")
        self._files = _file_system(scheme, options)

    def find(self, dataset_id: str) -> Release | None:
        split_id(dataset_id)
        manifest = self._object(dataset_id, MANIFEST)
        what = f"asking {self.address} for {dataset_id}"
        try:
            self._ask(what, lambda: self._files.info(manifest))
        except AbsentFileError:
            return None
        return Release(dataset_id, f"{self.address}/{dataset_id}")

    def ids(self) -> tuple[str, ...]:
        names = self._names(self._root, "its datasets")
        return tuple(name for name in names if is_id(name) and self.find(name))

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        source = self._object(release.id, file)
        what = f"fetching {release.address}/{file}"
        found = self._ask(what, lambda: self._files.info(source))["size"]
        check_size(f"{release.address}/{file}", found, size)

        def fetch() -> Path:
            # a name of its own for each attempt: one that was too slow may still be writing
            part = out.with_name(f"{out.name}.{uuid.uuid4().hex[:8]}.part")
            meter = Meter(self._pace, f"{release.address}/{file}")
            watched(
                lambda: self._files.get_file(source, str(part)),
                meter,
                lambda: part.stat().st_size if part.exists() else 0,
            )
            return part

        self._try(what, fetch).replace(out)

    def read_range(self, release: Release, file: str, first: int, size: int) -> bytes:
        source, what = self._object(release.id, file), f"fetching {release.address}/{file}"

        def fetch() -> bytes:
            content = bytes(self._files.cat_file(source, start=first, end=first + size))
            if len(content) != size:
                raise TransientError(f"{len(content)} bytes came, expected {size}")
            return content

        return self._ask(what, fetch)

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        split_id(dataset_id)
        files = files_to_publish(folder, dataset_id, beside)
        manifest = (folder / MANIFEST).read_bytes()
        if not self._is_published(dataset_id, manifest):
            claim = self._claim(dataset_id, hashlib.sha256(manifest).hexdigest())
            for name, file in files.items():
                if name not in (*claim, MANIFEST):
                    to = self._object(dataset_id, name)
                    self._try(f"sending {to}", partial(self._files.put_file, str(file), to))
                    if file.stat().st_size >= LARGE_FILE_BYTES:
                        claim.append(name)
                        self._put(self._object(dataset_id, CLAIM_FILE), "\n".join(claim).encode())
            if not self._create(self._object(dataset_id, MANIFEST), manifest):
                self._is_published(dataset_id, manifest)
        claimed = self._object(dataset_id, CLAIM_FILE)
        if self._content(claimed) is not None:
            self._try(f"deleting {claimed}", lambda: self._files.rm_file(claimed))
        self._write_index()
        return Release(dataset_id, f"{self.address}/{dataset_id}")

    def part_files(self, folder: str) -> tuple[str, ...]:
        return self._names(f"{self._root}/{folder}", folder)

    def send_part_file(self, folder: str, name: str, content: bytes) -> None:
        self._put(self._object(folder, name), content)

    def _names(self, path: str, what: str) -> tuple[str, ...]:
        """The sorted names below a path, none if nothing is there."""
        try:
            listed = self._ask(
                f"asking {self.address} for {what}", lambda: self._files.ls(path, detail=False)
            )
        except AbsentFileError:
            return ()
        return tuple(sorted({str(each).rstrip("/").rpartition("/")[2] for each in listed}))

    def _object(self, dataset_id: str, file: str) -> str:
        return f"{self._root}/{dataset_id}/{file}"

    def _is_published(self, dataset_id: str, manifest: bytes) -> bool:
        """Whether exactly this dataset is there."""
        there = self._content(self._object(dataset_id, MANIFEST))
        if there is not None and there != manifest:
            raise version_taken(dataset_id, self.address)
        return there is not None

    def _content(self, path: str) -> bytes | None:
        """The bytes of a small object, None if it is absent."""
        try:
            return self._try(
                f"reading {path}",
                lambda: bytes(self._files.cat_file(path, start=0, end=MAX_MANIFEST_BYTES)),
            )
        except AbsentFileError:
            return None

    def _claim(self, dataset_id: str, digest: str) -> list[str]:
        """Leaves this push's claim, or takes over that of an earlier push; returns its lines."""
        claim = self._object(dataset_id, CLAIM_FILE)
        if self._create(claim, digest.encode()):
            return [digest]
        lines = (self._content(claim) or b"").decode(errors="replace").split("\n")
        if lines[0] != digest:
            raise ConflictError(
                f"someone else is pushing another {dataset_id} to {self.address}, or was stopped "
                f"while doing so. Nothing of this push is visible. Wait, pull and compare; if that "
                f"push is dead, delete {self.address}/{dataset_id}/{CLAIM_FILE} and push again."
            )
        return lines

    def _create(self, path: str, content: bytes) -> bool:
        """Writes an object where there is none; says whether it did."""

        def write() -> bool:
            try:
                self._files.pipe_file(path, content, mode="create")
            except FileExistsError:
                return False
            return True

        return self._try(f"writing {path}", write)

    def _put(self, path: str, content: bytes) -> None:
        self._try(f"writing {path}", lambda: self._files.pipe_file(path, content))

    def _write_index(self) -> None:
        """Writes the index, again until no other push has changed it meanwhile."""
        listed = None
        while listed != (found := self.ids()):
            listed = found
            self._put(f"{self._root}/{INDEX_FILE}", index_bytes(found))

    def _ask(self, what: str, action: Callable[[], T]) -> T:
        return self._try(what, lambda: watched(action, Meter(self._pace, self.address)))

    def _try(self, what: str, action: Callable[[], T]) -> T:
        return self._backoff.call(self.address, what, action, _explained)


def _explained(error: Exception, what: str) -> Exception | None:
    """Translates an error of fsspec, whose errors have no common type; most of them may pass."""
    if isinstance(error, FileNotFoundError):
        return AbsentFileError(f"{what} failed: it is not there ({quoted(error)}).")
    if isinstance(error, OSError) and error.errno in LOCAL_ERRNOS:
        return None
    if isinstance(error, PermissionError) or type(error).__name__ in FINAL_ERRORS:
        return HubError(
            f"{what} failed: {quoted(error)}. Look whether your credentials are set and give "
            "access."
        )
    return TransientError(f"{type(error).__name__}: {quoted(error)}")


def _file_system(scheme: str, options: dict[str, Any] | None) -> Any:
    """The fsspec file system of a scheme; listings are never remembered."""
    import fsspec  # noqa: PLC0415  # takes longer than everything else here

    if scheme == "s3":
        require_extra("s3fs", "s3", "an s3:// remote")
    known = S3_OPTIONS if scheme == "s3" else {}
    try:
        return fsspec.filesystem(scheme, use_listings_cache=False, **{**known, **(options or {})})
    except ImportError as error:
        raise HubError(f"a {scheme}:// remote needs another package: {error}.") from error
