"""From an id or an address to a finished folder: the cache, then the remotes in order, a rebuild.

What comes from a remote is checked beside its place and gets there in one rename. One process at a
time fetches or builds, the others wait; a folder that is finished is used without a lock and
without a request.
"""

import hashlib
import os
import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.building.build import finish, is_finished, remove_parts
from swarmdata.cards.side_files import write_missing
from swarmdata.errors import (
    DatasetNotFoundError,
    DiskFullError,
    SwarmdataError,
)
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.remotes.addresses import Address, open_remote, parse_address
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.locate import locate
from swarmdata.hub.remotes.outside_names import is_id
from swarmdata.hub.remotes.pull_dataset import Refusal, pull, refuse_current_folder
from swarmdata.runtime.atomic import sync
from swarmdata.runtime.locking import locked
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest, open_store, read_manifest
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.scratch import remove_scratch, scratch_folder

OFFLINE = ("SWARMDATA_OFFLINE", "HF_HUB_OFFLINE")
"""Variables of the environment that keep `load` from asking remotes."""


class RemoteSkippedWarning(UserWarning):
    """A remote failed, or has another dataset under this id; the next source was tried."""


@dataclass(frozen=True)
class Found:
    """A finished dataset and where it came from."""

    folder: Path
    source: str  # `cache`, `rebuilt`, or the release's address


def is_offline(wanted: bool | None = None) -> bool:
    """Whether remotes are left alone: what the caller wants, else what the environment says."""
    if wanted is not None:
        return wanted
    return any(os.environ.get(name, "").upper() in ("1", "ON", "YES", "TRUE") for name in OFFLINE)


def obtain(
    recipe: Recipe,
    folder: Path,
    *,
    remotes: Sequence[str] = (),
    workers: int | None = None,
    progress: bool = True,
) -> Found:
    """Finds, fetches or builds the dataset of a recipe.

    Args:
        recipe: what the dataset is made from.
        folder: where it is or shall be.
        remotes: addresses to ask, in order, before building.
        workers: processes that build.
        progress: whether to show bars.

    Raises:
        BuildError: it could not be built, or `folder` cannot be written to.
        DatasetError: what is at `folder` cannot be used.
    """
    if is_finished(folder, recipe):
        return Found(folder, "cache")
    with locked(folder, progress):
        if is_finished(folder, recipe):
            return Found(folder, "cache")
        wanted = recipe.id, _refusal(recipe)
        source = None if folder.exists() else _fetch(*wanted, folder, remotes, progress)
        if source is None:
            finish(recipe, folder, workers=workers, progress=progress)
            return Found(folder, "rebuilt")
        remove_parts(recipe, folder)
        return Found(folder, source)


def obtain_foreign(
    name: str, cache: Path, *, remotes: Sequence[str] = (), progress: bool = True
) -> Found | None:
    """Finds or fetches a dataset that no shipped recipe makes; None if it is nowhere.

    Args:
        name: its id; without a version the newest, for which the remotes are asked.
        cache: the folder of datasets.
        remotes: addresses to ask, in order.
        progress: whether to show bars.
    """
    if not is_id(name) and not is_id(f"{name}-v0"):
        return None
    dataset = name if is_id(name) else _newest(name, [*_cached(cache), *_listed(remotes)])
    if dataset is None:
        return None
    folder = cache / dataset
    if _is_usable(folder):
        return Found(folder, "cache")
    if not remotes:
        return None
    with locked(folder, progress):
        if _is_usable(folder):
            return Found(folder, "cache")
        source = _fetch(dataset, _refusal(), folder, remotes, progress)
    return None if source is None else Found(folder, source)


def obtain_address(
    text: str, cache: Path, *, offline: bool = False, progress: bool = True
) -> Found:
    """Finds or fetches the dataset at an address such as `hf://org/coop_nav-medium@v0`.

    A version or a commit never changes, so what is in the cache is used without a request; for a
    branch, and for the newest version, the remote is asked.

    Args:
        text: the address.
        cache: the folder of what came from addresses; each remote has its own in there.
        offline: whether the remote must not be asked.
        progress: whether to show a bar.

    Raises:
        AddressError: the address is malformed, or not of a dataset.
        DatasetNotFoundError: offline, and it is not in the cache.
        HubError: the remote could not be asked, or does not have it.
        DatasetError: what it has cannot be used.
    """
    address = parse_address(text)
    place = cache / _slug(address.remote)
    name = _pinned(address)
    if offline and name is None and address.dataset is not None and address.revision is None:
        name = _newest(address.dataset, _cached(place))
    if name is not None and _is_usable(place / name):
        return Found(place / name, "cache")
    if offline:
        raise DatasetNotFoundError(
            f"{text} is not in the cache, and no remote was asked: this is offline. With a "
            f"network, and without {' and '.join(OFFLINE)}, run: swarmdata pull {text}"
        )
    remote, release = locate(text)
    if name is None:
        commit = release.address.rpartition("@")[2]
        name = release.id if address.revision is None else f"{address.dataset}@{commit}"
    folder = place / name
    with locked(folder, progress):
        if _is_usable(folder):
            return Found(folder, "cache")
        _arrive(remote, release, folder, _refusal(), progress)
    return Found(folder, release.address)


def obtain_release(remote: Remote, release: Release, folder: Path, progress: bool = True) -> Path:
    """Fetches a release to a folder, where it is not there yet, and returns the folder.

    Args:
        remote: where from.
        release: from `remote.find`.
        folder: the dataset's.
        progress: whether to show a bar.

    Raises:
        ChecksumError: the release is another dataset than the one published under its id.
        HubError: it could not be had.
        DatasetError: something else is at `folder`, or the release cannot be used.
    """
    refuse_current_folder(folder)
    with locked(folder, progress):  # nobody else builds or repairs it meanwhile
        if folder.exists() and any(folder.iterdir()):  # it is compared, and not changed
            pull(remote, release, folder, refuse=_refusal(), progress=progress)
        else:
            _arrive(remote, release, folder, _refusal(), progress)
    return folder


def _refusal(recipe: Recipe | None = None) -> Refusal:
    """Why a manifest on a remote is not wanted: not what its id says, or of another recipe."""

    def refuse(manifest: Manifest) -> str | None:
        identity = judge(manifest)
        if not identity.is_as_named:
            return identity.sentence
        if recipe is not None and manifest.recipe_hash != recipe.hash():
            return f"it is of recipe {manifest.recipe_hash[:12]}, expected {recipe.hash()[:12]}"
        return None

    return refuse


def _fetch(
    dataset: str, refuse: Refusal, folder: Path, remotes: Iterable[str], progress: bool
) -> str | None:
    """Takes the dataset from the first remote that has it; returns the release's address."""
    for address in remotes:
        try:
            remote = open_remote(address)
            release = remote.find(dataset)
            if release is not None:
                _arrive(remote, release, folder, refuse, progress)
                return release.address
        except DiskFullError:
            raise  # no fault of the remote, and the next one needs the same space
        except SwarmdataError as error:
            skip(address, dataset, error)
    return None


def skip(address: str, what: str, error: SwarmdataError) -> None:
    """Says that a remote is of no use, and why; the next source is tried."""
    message = f"{address} is skipped for {what}: {type(error).__name__}: {error}"
    warnings.warn(message, RemoteSkippedWarning, stacklevel=4)


def _arrive(
    remote: Remote, release: Release, folder: Path, refuse: Refusal, progress: bool
) -> None:
    """Pulls a release beside its place, checks every byte and what it is, and renames it."""
    arriving = scratch_folder(folder, "arriving")
    remove_scratch(arriving)  # of a process that was killed before it had checked it
    pull(remote, release, arriving, refuse=refuse, progress=progress)
    try:
        open_store(arriving, "full", widths=True)
        write_missing(arriving)
    except BaseException:
        remove_scratch(arriving)
        raise
    arriving.rename(folder.resolve())  # where a link leads, if it is one
    sync(arriving.parent)


def _is_usable(folder: Path) -> bool:
    """Whether a dataset is there.

    Raises:
        DatasetError: what is there has lost its manifest; the message says how to repair it.
    """
    return folder.exists() and bool(read_manifest(folder))


def _is_complete(folder: Path) -> bool:
    """Whether a dataset was published there; folders appear whole."""
    return (folder / MANIFEST).exists()


def _cached(place: Path) -> list[str]:
    return [path.name for path in place.glob("*-v*") if is_id(path.name) and _is_complete(path)]


def _listed(remotes: Iterable[str]) -> list[str]:
    """The ids of all remotes that answer."""
    ids: list[str] = []
    for address in remotes:
        try:
            ids += open_remote(address).ids()
        except SwarmdataError as error:
            skip(address, "its list of datasets", error)
    return ids


def _newest(name: str, ids: Iterable[str]) -> str | None:
    """The id with the highest version of a name, None if there is none."""
    versions = [int(each.rpartition("-v")[2]) for each in ids if each.rpartition("-v")[0] == name]
    return f"{name}-v{max(versions)}" if versions else None


def _pinned(address: Address) -> str | None:
    """Name of the cached folder of what never changes; None where the remote must be asked."""
    if address.dataset is None or is_id(address.dataset):
        return address.dataset
    if address.revision is None:
        return None
    if re.fullmatch(r"v[0-9]+", address.revision):
        return f"{address.dataset}-{address.revision}"
    is_commit = re.fullmatch(r"[0-9a-f]{40}", address.revision)
    return f"{address.dataset}@{address.revision}" if is_commit else None


def _slug(remote: str) -> str:
    """A folder's name for a remote: readable, and of no other remote."""
    digest = hashlib.sha256(remote.encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9.]+', '-', remote)[:80]}-{digest}"
