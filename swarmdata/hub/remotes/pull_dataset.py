"""Pulling a dataset: manifest first, every file checked on the way in, visible at once or never."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from swarmdata.errors import (
    ChecksumError,
    DatasetError,
    FormatVersionError,
    HubError,
    SwarmdataError,
)
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.network.pace import bytes_in, run_all
from swarmdata.hub.remotes.release_files import contradictions
from swarmdata.runtime.atomic import disk_full_explained, is_vacant, put_in_place, sync, sync_tree
from swarmdata.runtime.locking import beside, locked
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import (
    MAX_MANIFEST_BYTES,
    FileEntry,
    Manifest,
    read_manifest,
    without_hint,
)
from swarmdata.store.scratch import remove_scratch, scratch_folder

N_WORKERS = 4  # files fetched at a time

BAR_SECONDS = 0.5  # seconds between two looks at how much has arrived

Refusal = Callable[[Manifest], str | None]
"""Why a dataset of this manifest is not wanted, None if it is."""

_INCOMING = "incoming"
"""Folder among the collected files where the manifest waits until all that it lists is there."""


def pull(
    remote: Remote,
    release: Release,
    folder: Path,
    *,
    refuse: Refusal = lambda manifest: None,
    progress: bool = True,
) -> Path:
    """Fetches a release into a new folder and returns the folder; a folder that has it is left.

    Only what the manifest lists is fetched; card and references, which are in no digest, are taken
    from nobody. Files are collected and checked beside the folder, in `scratch_folder(folder,
    "pull")`, and the folder appears in one rename. Kill the process at any time and call again:
    finished files are kept. Where another process pulls to the same folder, this one waits for it.

    Raises:
        ChecksumError: `refuse` has a reason against it, or the remote gives wrong bytes.
        FormatVersionError: a newer format.
        HubError: the remote could not be asked, or gave what it must not.
        DatasetError: something else is at `folder`, or the disk is too small.
        DiskFullError: no space was left; what has arrived is kept.
    """
    folder = Path(folder)
    refuse_current_folder(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch, whole = scratch_folder(folder, "pull"), folder.resolve()
    with locked(scratch, progress):
        manifest = _incoming_manifest(remote, release, scratch, refuse)
        if not is_vacant(folder):
            try:
                _check_same(folder, scratch / _INCOMING)
            finally:
                remove_scratch(scratch)
            return folder
        _check_space(manifest, scratch, release)
        with disk_full_explained(folder, scratch):
            with tqdm(
                desc=f"pulling {release.id}",
                total=sum(entry.size for entry in manifest.files.values()),
                unit="B",
                unit_scale=True,
                disable=not progress,
            ) as bar:
                _fetch_all(remote, release, manifest, scratch, bar)
            _publish(manifest, scratch, whole)
    return folder


def refuse_current_folder(folder: Path) -> None:
    """A dataset appears in one rename, which cannot replace the current folder of a process."""
    whole = folder.resolve()
    if whole == Path.cwd() and beside(whole) != whole and not (whole / MANIFEST).exists():
        raise DatasetError(
            f"a dataset cannot be pulled to the current folder {whole}, only to one "
            "that is not there yet. Name such a folder."
        )


def fetch_file(remote: Remote, release: Release, manifest: Manifest, file: str, out: Path) -> None:
    """Does what `fetch_checked` does for a file of a dataset; HubError if its manifest lacks it."""
    entry = manifest.files.get(file)
    if entry is None:
        raise HubError(f"{release.id} has no file {file!r}: its manifest does not list it.")
    fetch_checked(remote, release, file, entry, out)


def fetch_checked(remote: Remote, release: Release, file: str, entry: FileEntry, out: Path) -> None:
    """Fetches one file of known size and SHA-256, checks it, and puts it at `out` in one rename.

    Raises:
        ChecksumError: the remote gave wrong bytes, twice.
        HubError: it could not be fetched.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    arriving = out.with_name(f"{out.name}.arriving")
    _read_checked(remote, release, file, entry, arriving)
    sync(arriving)
    arriving.replace(out)
    sync(out.parent)


def _read_checked(
    remote: Remote, release: Release, file: str, entry: FileEntry, arriving: Path
) -> None:
    """Fetches a file as its entry says, once more if it was changed on the way."""
    for attempt in (1, 2):
        remote.read(release, file, arriving, entry.size)
        problem = difference(arriving, entry)
        if problem is None:
            return
        arriving.unlink()
        if attempt == 2:
            raise ChecksumError(
                f"{release.address} gave wrong bytes of {file} twice: {problem}. They were thrown "
                "away; pull from another remote, and tell whoever publishes there."
            )


def difference(path: Path, entry: FileEntry) -> str | None:
    """In what a file differs from its entry in the manifest, None if in nothing."""
    size = path.stat().st_size
    if size != entry.size:
        return f"{size} bytes, expected {entry.size}"
    found = file_digest(path)
    return None if found == entry.sha256 else f"SHA-256 {found}, expected {entry.sha256}"


def _incoming_manifest(
    remote: Remote, release: Release, scratch: Path, refuse: Refusal
) -> Manifest:
    """Fetches and checks the manifest; what `scratch` holds of another release is deleted."""
    arriving = scratch.with_name(f"{scratch.name}.manifest")
    arriving.mkdir(exist_ok=True)
    try:
        manifest = fetch_manifest(remote, release, arriving, refuse)
    except SwarmdataError:
        remove_scratch(arriving)
        raise
    if not _belongs(scratch, (arriving / MANIFEST).read_bytes()):
        remove_scratch(scratch)
        scratch.mkdir()
    remove_scratch(scratch / _INCOMING)
    arriving.rename(scratch / _INCOMING)
    return manifest


def fetch_manifest(remote: Remote, release: Release, folder: Path, refuse: Refusal) -> Manifest:
    """Fetches the manifest to a folder and checks it, also with the caller's `refuse`."""
    manifest = _read_manifest(remote, release, folder)
    if problems := contradictions(manifest, release.id):
        raise HubError(
            f"the manifest of {release.address} is refused: {'; '.join(problems)}. "
            "Pull from another remote, and tell whoever publishes there."
        )
    if (reason := refuse(manifest)) is not None:
        raise ChecksumError(
            f"{release.address} is not the {release.id} that is wanted: {reason}. Pull it from "
            "another remote."
        )
    return manifest


def _belongs(scratch: Path, manifest: bytes) -> bool:
    """Whether `scratch` was begun with this manifest, wherever in `_publish` it was left."""
    kept = (scratch / _INCOMING / MANIFEST, scratch / MANIFEST)
    return any(path.exists() and path.read_bytes() == manifest for path in kept)


def _read_manifest(remote: Remote, release: Release, folder: Path) -> Manifest:
    """Fetches the manifest, once more if it was changed on the way."""
    for attempt in (1, 2):
        remote.read(release, MANIFEST, folder / MANIFEST, MAX_MANIFEST_BYTES)
        try:
            return read_manifest(folder)
        except FormatVersionError as error:
            raise FormatVersionError(
                f"{release.address} was written in a format newer than this library reads. "
                "Upgrade it with: pip install --upgrade swarmdata"
            ) from error
        except DatasetError as error:
            (folder / MANIFEST).unlink()
            if attempt == 2:
                problem = without_hint(str(error), folder).replace(str(folder), release.address)
                raise ChecksumError(
                    f"{release.address} has no usable manifest, it was fetched twice: {problem}. "
                    "Pull from another remote, and tell whoever publishes there."
                ) from error
    raise AssertionError("the second attempt returns or raises")


def _check_same(folder: Path, incoming: Path) -> None:
    there = folder / MANIFEST
    if there.is_file() and there.read_bytes() == (incoming / MANIFEST).read_bytes():
        return
    raise DatasetError(
        f"{folder} is there already and is not this release. Pull elsewhere, or move it away."
    )


def _check_space(manifest: Manifest, scratch: Path, release: Release) -> None:
    needed = sum(
        entry.size for name, entry in manifest.files.items() if not (scratch / name).exists()
    )
    free = shutil.disk_usage(scratch).free
    if needed > free:
        raise DatasetError(
            f"pulling {release.id} needs {needed:,} bytes more, {free:,} are free in "
            f"{scratch.parent}. Free some space, or name another folder with SWARMDATA_CACHE."
        )


def _fetch_all(
    remote: Remote, release: Release, manifest: Manifest, scratch: Path, bar: "tqdm[Any]"
) -> None:
    """Fetches what is not there, a few files at a time; the first error stops the rest."""

    def fetch(name: str) -> None:
        entry, out = manifest.files[name], scratch / name
        if not out.is_file() or difference(out, entry) is not None:
            out.parent.mkdir(parents=True, exist_ok=True)
            arriving = out.with_name(f"{out.name}.arriving")
            _read_checked(remote, release, name, entry, arriving)
            arriving.replace(out)  # flushed to the disk with everything else, by `_publish`

    def show() -> None:
        bar.n = min(bar.total or 0, bytes_in(scratch))  # also of files that are still arriving
        bar.refresh()

    # large files first, so that no thread begins one when the others have ended
    order = sorted(manifest.files, key=lambda name: -manifest.files[name].size)
    run_all([partial(fetch, name) for name in order], N_WORKERS, show, BAR_SECONDS)


def _publish(manifest: Manifest, scratch: Path, folder: Path) -> None:
    """Makes the finished folder visible in one rename, with everything on the disk before."""
    shutil.copyfile(scratch / _INCOMING / MANIFEST, scratch / MANIFEST)
    expected = {scratch / name for name in (*manifest.files, MANIFEST)}
    for path in sorted(scratch.rglob("*"), reverse=True):  # what is in a folder before the folder
        if path.is_dir() and not path.is_symlink():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in expected:
            path.unlink()  # the waiting manifest, and what broken attempts left
    sync_tree(scratch)
    put_in_place(scratch, folder, MANIFEST)
    sync(folder.parent)
    remove_scratch(scratch)  # at a mount point, an empty folder is left of it
