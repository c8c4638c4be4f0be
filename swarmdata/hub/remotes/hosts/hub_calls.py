"""The calls of huggingface_hub that a remote makes, each tried again while its failure may pass."""

import contextlib
import errno
import hashlib
import json
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from swarmdata.errors import AbsentFileError, ConflictError, HubError, quoted
from swarmdata.hub.remotes.network.backoff import LOCAL_ERRNOS, Backoff, TransientError, seconds
from swarmdata.hub.remotes.network.pace import Meter, Pace, bytes_in, watched
from swarmdata.hub.remotes.release_files import check_listing
from swarmdata.store.arrays.shards import file_digest

T = TypeVar("T")

REPOSITORY_TYPE = "dataset"

TIMEOUT_SECONDS = 30.0
"""Seconds without an answer before asking counts as failed; the client would wait for ever."""

HUB_TAG = "swarmdata"  # in the front matter of every card, so that a Hub can list our datasets


@dataclass(frozen=True)
class Listed:
    """One file of a commit."""

    size: int  # in bytes
    blob: str | None  # the SHA-1 that git gives a plain file, hex
    sha256: str | None  # of a file in large file storage, None for a plain one

    def is_of(self, path: Path) -> bool:
        """Whether a local file has the same content."""
        if path.stat().st_size != self.size:
            return False
        if self.sha256 is not None:
            return file_digest(path) == self.sha256
        content = path.read_bytes()
        plain = hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False)
        return plain.hexdigest() == self.blob


class HubCalls:
    """Requests to one Hub, each tried again while its failure may pass."""

    def __init__(self, address: str, endpoint: str | None, backoff: Backoff, pace: Pace) -> None:
        self._address, self._endpoint = address, endpoint
        self._backoff, self._pace = backoff, pace

    def look(self, repository: str, revision: str) -> tuple[str, Mapping[str, Listed]] | None:
        """The commit of a revision and its files; None: there is no such repository or revision."""

        def ask() -> Any:
            from huggingface_hub.errors import (  # noqa: PLC0415
                GatedRepoError,
                RepositoryNotFoundError,
                RevisionNotFoundError,
            )

            try:
                return self._api().dataset_info(
                    repository, revision=revision, files_metadata=True, timeout=TIMEOUT_SECONDS
                )
            except GatedRepoError:
                raise
            except (RepositoryNotFoundError, RevisionNotFoundError):
                return None

        info = self._ask(f"asking for {repository}@{revision}", ask)
        if info is None:
            return None
        address = f"{self._address.partition('://')[0]}://{repository}@{revision}"
        files = info.siblings or []
        check_listing(address, tuple(file.rfilename for file in files))
        if not re.fullmatch("[0-9a-f]{40}", info.sha or ""):
            raise HubError(f"{address} is at {info.sha!r}, expected a commit of 40 hex digits.")
        return info.sha, {file.rfilename: _listed(file, address) for file in files}

    def tags(self, repository: str) -> tuple[str, ...]:
        """The names of a repository's tags, none if there is no such repository."""

        def ask() -> tuple[str, ...]:
            from huggingface_hub.errors import RepositoryNotFoundError  # noqa: PLC0415

            try:
                refs = self._api().list_repo_refs(repository, repo_type=REPOSITORY_TYPE)
            except RepositoryNotFoundError:
                return ()
            return tuple(tag.name for tag in refs.tags)

        return self._ask(f"asking for the versions of {repository}", ask)

    def repositories(self, organization: str) -> tuple[str, ...]:
        """The names of an organization's repositories that have our tag."""

        def ask() -> tuple[str, ...]:
            found = self._api().list_datasets(author=organization, filter=HUB_TAG)
            return tuple(info.id.partition("/")[2] for info in found)

        return self._ask(f"asking for the datasets of {organization}", ask)

    def download(self, repository: str, commit: str, path: str, folder: Path) -> None:
        """Puts one file below `folder`, where a partial file of an earlier attempt is used."""
        what = f"fetching {path} of {repository}@{commit[:12]}"

        def fetch() -> None:
            self._api().hf_hub_download(
                repository, path, repo_type=REPOSITORY_TYPE, revision=commit, local_dir=folder
            )

        def watch() -> None:
            watched(fetch, Meter(self._pace, self._address), lambda: bytes_in(folder))

        with quiet():
            self._call(what, watch)

    def read_range(self, repository: str, commit: str, path: str, first: int, size: int) -> bytes:
        """Returns some bytes of a file."""
        what = f"fetching {path} of {repository}@{commit[:12]}"

        def fetch() -> bytes:
            from huggingface_hub import hf_hub_url  # noqa: PLC0415

            client = import_module("huggingface_hub.utils")
            url = hf_hub_url(
                repository,
                path,
                repo_type=REPOSITORY_TYPE,
                revision=commit,
                endpoint=self._api().endpoint,
            )
            wanted = {"Range": f"bytes={first}-{first + size - 1}"}
            response = client.get_session().get(
                url, headers={**client.build_hf_headers(), **wanted}, timeout=TIMEOUT_SECONDS
            )
            client.hf_raise_for_status(response)
            if len(response.content) != size:
                raise TransientError(f"{len(response.content)} bytes came, expected {size}")
            return bytes(response.content)

        return self._ask(what, fetch)

    def create(self, repository: str) -> None:
        """Makes an empty repository, unless it is there."""
        self._call(
            f"making {repository}",
            lambda: self._api().create_repo(repository, repo_type=REPOSITORY_TYPE, exist_ok=True),
        )

    def commit(
        self,
        repository: str,
        parent: str,
        message: str,
        files: Mapping[str, Path],
        stale: Sequence[str],
        settled: Callable[[], str | None],
    ) -> str:
        """Sends large files, then makes one commit that adds `files` and deletes `stale`.

        `main` must still be at `parent`. After a failure, `settled` returns the commit if it was
        made after all, None if `main` is unchanged, and raises if someone else made one.
        """
        from huggingface_hub import CommitOperationAdd, CommitOperationDelete  # noqa: PLC0415

        def attempt() -> str:
            adds = [CommitOperationAdd(name, str(path)) for name, path in files.items()]
            deletes = [CommitOperationDelete(name) for name in stale]
            try:
                made = self._api().create_commit(
                    repository,
                    [*adds, *deletes],
                    commit_message=message,
                    repo_type=REPOSITORY_TYPE,
                    parent_commit=parent,
                )
            except Exception:  # whatever it was, the commit may have been made
                commit = settled()
                if commit is None:
                    raise
                return commit
            return str(made.oid)

        return self._call(f"committing to {repository}", attempt)

    def tag(self, repository: str, tag: str, commit: str) -> bool:
        """Gives a commit a tag; False: the tag is there already, whoever made it."""

        def make() -> bool:
            try:
                self._api().create_tag(
                    repository, tag=tag, revision=commit, repo_type=REPOSITORY_TYPE
                )
            except Exception as error:
                if status_of(error) == 409:
                    return False
                raise
            return True

        return self._call(f"tagging {repository}@{commit[:12]} as {tag}", make)

    def _api(self) -> Any:
        from huggingface_hub import HfApi  # noqa: PLC0415

        return HfApi(endpoint=self._endpoint)

    def _ask(self, what: str, action: Callable[[], T]) -> T:
        return self._call(what, lambda: watched(action, Meter(self._pace, self._address)))

    def _call(self, what: str, action: Callable[[], T]) -> T:
        return self._backoff.call(self._address, what, action, explained)


def _listed(file: Any, address: str) -> Listed:
    if not isinstance(file.size, int):
        raise HubError(f"{address} lists {file.rfilename!r} without its size.")
    return Listed(file.size, file.blob_id, file.lfs.sha256 if file.lfs else None)


_QUIET = threading.Lock()
_quiet_users = 0
_was_quiet = False


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Hides the client's own bar for each file; several threads may be inside."""
    global _quiet_users, _was_quiet  # noqa: PLW0603  # the client's switch is global as well
    import huggingface_hub.utils as client  # noqa: PLC0415

    utils: Any = client  # the switches are public, but not marked as exported
    with _QUIET:
        if _quiet_users == 0:
            _was_quiet = utils.are_progress_bars_disabled()
            if not _was_quiet:
                utils.disable_progress_bars()
        _quiet_users += 1
    try:
        yield
    finally:
        with _QUIET:
            _quiet_users -= 1
            if _quiet_users == 0 and not _was_quiet:
                utils.enable_progress_bars()


HTTP_LIBRARIES = ("requests", "urllib3", "httpx", "httpx2", "httpcore", "httpcore2", "hf_xet")
"""Whose errors are failures of the network, or of the server behind it."""

NAME_ERRNOS = (errno.ENAMETOOLONG, errno.ENOENT, errno.ENOTDIR, errno.EINVAL)
"""What a system says of a file's name that leads nowhere."""


def explained(error: Exception, what: str) -> Exception | None:
    """Translates an error of the client; None where it is no failure of a remote."""
    status = status_of(error)
    if status is not None:
        return _of_status(error, status, what)
    is_partial = str(getattr(error, "filename", None)).endswith(".incomplete")  # named by its ETag
    if isinstance(error, OSError) and error.errno in NAME_ERRNOS and is_partial:
        return HubError(
            f"{what} failed: the server's ETag cannot be part of a file's name, as the client has "
            "it. Tell whoever runs it, or pull from another remote."
        )
    if isinstance(error, OSError) and (error.filename is not None or error.errno in LOCAL_ERRNOS):
        return None
    problem = _words(error)
    network = OSError | RuntimeError | json.JSONDecodeError  # hf_xet raises RuntimeError
    if isinstance(error, network) or type(error).__module__.partition(".")[0] in HTTP_LIBRARIES:
        return TransientError(problem)
    if isinstance(error, ValueError):  # of names, and of the card's front matter
        return HubError(f"{what} failed: {problem}")
    return None


def _of_status(error: Exception, status: int, what: str) -> Exception:
    from huggingface_hub.errors import EntryNotFoundError  # noqa: PLC0415

    if status in (408, 425, 429) or status >= 500:
        headers = getattr(_response(error), "headers", {})
        return TransientError(f"HTTP {status}", seconds(headers.get("Retry-After")))
    if isinstance(error, EntryNotFoundError):
        return AbsentFileError(f"{what} failed: the repository has no such file.")
    problem = _words(error)
    if status == 412:
        return ConflictError(
            f"{what} failed: someone else has pushed there since. Nothing of this push is visible. "
            "Pull what is there, compare, and push again."
        )
    if status in (401, 403):
        return HubError(
            f"{what} failed, HTTP {status}: this token may not do that, or there is none. Log in "
            f"with `hf auth login`, or set HF_TOKEN. The Hub says: {problem}"
        )
    return HubError(f"{what} failed, HTTP {status}: {problem}")


def _response(error: BaseException) -> Any:
    """The HTTP answer behind an error, or behind what it was raised from."""
    at: BaseException | None = error
    for _ in range(10):  # causes of causes, which are not many
        if at is None:
            break
        response = getattr(at, "response", None)
        if response is not None:
            return response
        at = at.__cause__
    return None


def status_of(error: BaseException) -> int | None:
    """The HTTP status of the answer behind an error, None if there was no answer."""
    return getattr(_response(error), "status_code", None)


def _words(error: BaseException) -> str:
    """An error and its cause in one line, without tokens."""
    from huggingface_hub import get_token  # noqa: PLC0415

    text = f"{type(error).__name__}: {error}".rstrip(". \n")
    cause = error.__cause__
    if cause is not None and str(cause) not in text:
        text += f" ({type(cause).__name__}: {cause})"
    if token := get_token():
        text = text.replace(token, "***")
    return quoted(re.sub(r"\bhf_[A-Za-z0-9]{8,}", "hf_***", text))
