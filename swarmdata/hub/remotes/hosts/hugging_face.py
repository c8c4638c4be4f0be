"""Datasets of one organization of a Hugging Face Hub, `hf://org`: a repository per dataset."""

import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from swarmdata.errors import AbsentFileError, ConflictError, HubError, SpecError
from swarmdata.hub.remotes.hosts.hub_calls import HubCalls, Listed
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.remotes.network.backoff import Backoff
from swarmdata.hub.remotes.network.pace import Pace
from swarmdata.hub.remotes.release_files import check_size, files_to_publish, version_taken
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.outside_names import is_id, split_id
from swarmdata.store.arrays.layout import DATA, MANIFEST
from swarmdata.store.manifest import MAX_MANIFEST_BYTES
from swarmdata.store.scratch import remove_scratch, scratch_folder

MAIN_BRANCH = "main"  # the branch of the newest push

_COMMIT = re.compile(r"[0-9a-f]{40}")
_VERSION = re.compile(r"v[0-9]+")


class HubRemote:
    """Each dataset is a repository named like its id without version; a tag is a version.

    A push is one commit on `main`, then the tag, so `main` never holds half a dataset. What is
    read is pinned to a commit. The endpoint is `HF_ENDPOINT`, the token that of `hf auth login` or
    `HF_TOKEN`.
    """

    def __init__(self, address: str, *, backoff: Backoff | None = None) -> None:
        self.address = address
        self._organization = address.removeprefix("hf://")
        pace = Pace.from_environment()
        self._calls = HubCalls(address, os.environ.get("HF_ENDPOINT"), backoff or Backoff(), pace)
        self._listings: dict[tuple[str, str], Mapping[str, Listed]] = {}

    def find(self, dataset_id: str) -> Release | None:
        commit = self._dataset_at(*split_id(dataset_id))
        return None if commit is None else self._release(dataset_id, commit)

    def at(self, name: str, revision: str | None = None) -> Release | None:
        """Looks for a repository's dataset at a tag or commit; without one, the newest version."""
        if revision is None:
            versions = self._versions(name)
            if not versions:
                return None
            revision = versions[-1]
        if is_id(f"{name}-{revision}"):
            return self.find(f"{name}-{revision}")
        commit = self._dataset_at(name, revision)
        if commit is None:
            return None
        with tempfile.TemporaryDirectory() as scratch:
            unnamed, manifest = self._release(name, commit), Path(scratch, MANIFEST)
            self.read(unnamed, MANIFEST, manifest, MAX_MANIFEST_BYTES)
            found = self._release(_id_in(manifest, unnamed.address), commit)
        if found.address != unnamed.address:
            raise HubError(
                f"{unnamed.address} holds {found.id}, expected a repository of the dataset's name. "
                "Nothing of it is used; tell whoever publishes there."
            )
        return found

    def _dataset_at(self, name: str, revision: str) -> str | None:
        """The commit of a revision, if it has a dataset."""
        commit = self._look(name, revision)
        return commit if commit and MANIFEST in self._listings[name, commit] else None

    def ids(self) -> tuple[str, ...]:
        repositories = self._calls.repositories(self._organization)
        return tuple(
            sorted(
                f"{name}-{version}"
                for name in repositories
                if is_id(f"{name}-v0")
                for version in self._versions(name)
            )
        )

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        name, commit = self._pinned(release)
        listing = self._listing(name, commit)
        if file not in listing:
            raise AbsentFileError(f"{release.address} has no file {file!r}.")
        check_size(f"{release.address}/{file}", listing[file].size, size)
        scratch = scratch_folder(out, "hub")  # kept after a failure: the client resumes
        self._calls.download(self._repository(name), commit, file, scratch)
        (scratch / file).replace(out)
        remove_scratch(scratch)

    def read_range(self, release: Release, file: str, first: int, size: int) -> bytes:
        name, commit = self._pinned(release)
        if file not in self._listing(name, commit):
            raise AbsentFileError(f"{release.address} has no file {file!r}.")
        return self._calls.read_range(self._repository(name), commit, file, first, size)

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        name, version = split_id(dataset_id)
        files = files_to_publish(folder, dataset_id, beside)
        tagged = self._look(name, version)
        if tagged is not None:
            return self._published(dataset_id, name, tagged, files)
        head = self._look(name, MAIN_BRANCH)
        if head is None:
            self._calls.create(self._repository(name))
            head = self._look(name, MAIN_BRANCH)
        if head is None:
            raise HubError(
                f"{self.address}/{name} was made, but has no branch {MAIN_BRANCH}. Try again."
            )
        commit = head if self._holds(name, head, files) else self._commit(dataset_id, head, files)
        if not self._calls.tag(self._repository(name), version, commit):
            tagged = self._look(name, version)
            return self._published(dataset_id, name, tagged or commit, files)
        return self._release(dataset_id, commit)

    def _commit(self, dataset_id: str, head: str, files: Mapping[str, Path]) -> str:
        """Makes one commit on top of `head`, and looks whether it is there as it was meant."""
        name, _ = split_id(dataset_id)
        stale = sorted(_data(self._listing(name, head)) - set(files))

        def settled() -> str | None:
            """The commit, if an attempt was heard although its answer was lost."""
            commit = self._look(name, MAIN_BRANCH)
            if commit is None or commit == head:
                return None
            if not self._holds(name, commit, files):
                raise ConflictError(
                    f"someone else pushed to {self.address}/{name} meanwhile. Nothing of this push "
                    f"is visible. Run `swarmdata pull {self.address}/{name}`, compare, and push "
                    "again under a version that is not taken."
                )
            return commit

        commit = self._calls.commit(self._repository(name), head, dataset_id, files, stale, settled)
        if not self._holds(name, commit, files):
            raise HubError(
                f"{self.address}/{name}@{commit} does not hold the files that were sent, so it has "
                "no tag. Push again."
            )
        return commit

    def _published(
        self, dataset_id: str, name: str, commit: str, files: Mapping[str, Path]
    ) -> Release:
        """The release of a tag that is there already, if it has exactly these data."""
        if not self._holds(name, commit, {MANIFEST: files[MANIFEST]}, everything=False):
            raise version_taken(dataset_id, self._release(dataset_id, commit).address)
        return self._release(dataset_id, commit)

    def _holds(
        self, name: str, commit: str, files: Mapping[str, Path], *, everything: bool = True
    ) -> bool:
        """Whether a commit has these files, and with `everything` no other data."""
        listing = self._listing(name, commit)
        if everything and not _data(listing) <= set(files):
            return False
        return all(path in listing and listing[path].is_of(local) for path, local in files.items())

    def _look(self, name: str, revision: str) -> str | None:
        """Resolves a revision to its commit and remembers the listing; None if there is none."""
        found = self._calls.look(self._repository(name), revision)
        if found is None:
            return None
        commit, listing = found
        self._listings[name, commit] = listing
        return commit

    def _listing(self, name: str, commit: str) -> Mapping[str, Listed]:
        if (name, commit) not in self._listings and self._look(name, commit) is None:
            raise AbsentFileError(f"there is no commit {commit} at {self.address}/{name}.")
        return self._listings[name, commit]

    def _versions(self, name: str) -> list[str]:
        tags = self._calls.tags(self._repository(name))
        return sorted(filter(_VERSION.fullmatch, tags), key=lambda tag: int(tag[1:]))

    def _pinned(self, release: Release) -> tuple[str, str]:
        name, _, commit = release.address.removeprefix(f"{self.address}/").partition("@")
        if not _COMMIT.fullmatch(commit):
            raise HubError(
                f"{release.address} is not pinned to a commit of {self.address}, expected "
                f"{self.address}/name@<40 hex digits>."
            )
        return name, commit

    def _release(self, dataset_id: str, commit: str) -> Release:
        name = split_id(dataset_id)[0] if is_id(dataset_id) else dataset_id
        return Release(dataset_id, f"{self.address}/{name}@{commit}")

    def _repository(self, name: str) -> str:
        return f"{self._organization}/{name}"


def _data(paths: Iterable[str]) -> set[str]:
    """Those of the paths that belong to the arrays."""
    return {path for path in paths if path.startswith(f"{DATA}/")}


def _id_in(manifest: Path, address: str) -> str:
    """The id that a manifest has, before it is checked as a whole."""
    try:
        data = read_document(manifest)
    except (OSError, SpecError) as error:
        raise HubError(f"{address} has a manifest that is not JSON: {error}.") from error
    found = data.get("id") if isinstance(data, dict) else None
    if not isinstance(found, str) or not is_id(found):
        raise HubError(f"{address} has a manifest without the id of a dataset, got {found!r:.100}.")
    return found
