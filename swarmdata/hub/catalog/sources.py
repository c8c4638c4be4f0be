"""From a request to a finished folder: the first of cache, remotes and rebuild that has it.

One process at a time fetches or builds; a finished folder needs neither a lock nor a remote.
"""

import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from swarmdata.building.build import build_under_lock, remove_parts
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    DatasetError,
    DatasetNotFoundError,
    DiskFullError,
    SpecError,
    SwarmdataError,
    UnknownNameError,
)
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.listing import cached_ids
from swarmdata.hub.catalog.request import (
    Found,
    Request,
    cached,
    lost_edit,
    request_of_id,
    request_of_recipe,
    shipped_recipe,
)
from swarmdata.hub.remotes.addresses import Address, configured_remotes, open_remote
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.pull_dataset import Refusal, pull, refuse_current_folder
from swarmdata.hub.remotes.release_lookup import locate
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.atomic import is_vacant, put_in_place, sync
from swarmdata.runtime.cache_folder import OFFLINE_VARIABLES
from swarmdata.runtime.locking import locked
from swarmdata.runtime.outside_names import is_id
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest, open_store
from swarmdata.store.arrays.layout import CARD, DATA, MANIFEST, RECIPE, REFERENCES
from swarmdata.store.manifest import without_hint
from swarmdata.store.scratch import remove_scratch, scratch_folder

T = TypeVar("T")


class RemoteSkippedWarning(UserWarning):
    """A remote failed, or has another dataset under this id; the next source was tried."""


@dataclass(frozen=True)
class Remotes:
    """Remotes that are asked in order; one that fails is skipped with a warning."""

    addresses: Sequence[str] | None = None  # of the remotes; None: those that are configured
    offline: bool = False  # whether no remote is asked, not even that of a request's own address
    progress: bool = True  # whether to show a bar

    @property
    def asked(self) -> Sequence[str]:
        """Addresses of the remotes that are asked."""
        if self.offline:
            return ()
        return configured_remotes() if self.addresses is None else self.addresses

    def pin(self, request: Request) -> Request:
        """Asks which version or release is meant; `folder` stays None where there is none."""
        if request.address is not None:
            return self._located(request, request.address)
        newest = None
        if request.folder is None and is_id(f"{request.text}-v0"):
            newest = self.newest(request.text, cached_ids(request.place))
        return replace(request, folder=request.place / newest) if newest else request

    def newest(self, name: str, others: Iterable[str] = ()) -> str | None:
        """The id of the newest version of a name on the remotes and among other ids."""
        return _newest(name, [*others, *self._listed()])

    def get(self, request: Request) -> Found | None:
        """Fetches the dataset; an address is fetched from there or is an error."""
        folder = request.folder
        if folder is None or not is_vacant(folder):
            return None
        refuse = refusal(request.recipe)

        def fetch(remote: Remote, release: Release) -> Found:
            _arrive(remote, release, folder, refuse, self.progress)
            return Found(folder, release.address)

        if request.release is not None:
            return fetch(*request.release)
        return self.first(folder.name if request.recipe is None else request.recipe.id, fetch)

    def first(self, dataset: str, use: Callable[[Remote, Release], T]) -> T | None:
        """What `use` makes of the first release of an id that it does not refuse."""
        for address in self.asked:
            try:
                remote = open_remote(address)
                release = remote.find(dataset)
                if release is not None:
                    return use(remote, release)
            except DiskFullError:
                raise  # no fault of the remote, and the next one needs the same space
            except SwarmdataError as error:
                skip(address, dataset, error)
        return None

    def _located(self, request: Request, address: Address) -> Request:
        if self.offline:
            is_newest = address.dataset is not None and address.revision is None
            cached = _newest(str(address.dataset), cached_ids(request.place)) if is_newest else None
            if cached is None or request.folder is not None:
                raise DatasetNotFoundError(
                    f"{request.text} is not in the cache, and no remote was asked: this is offline."
                    f" With a network, and without {' and '.join(OFFLINE_VARIABLES)}, run: "
                    f"swarmdata pull {request.text}"
                )
            return replace(request, folder=request.place / cached)
        remote, release = locate(request.text)
        commit = release.address.rpartition("@")[2]
        name = release.id if address.revision is None else f"{address.dataset}@{commit}"
        folder = request.folder or request.place / name
        return replace(request, folder=folder, release=(remote, release))

    def _listed(self) -> list[str]:
        """The ids of all remotes that answer."""
        ids: list[str] = []
        for address in self.asked:
            try:
                ids += open_remote(address).ids()
            except SwarmdataError as error:
                skip(address, "its list of datasets", error)
        return ids


@dataclass(frozen=True)
class Rebuild:
    """Makes a dataset again: from its recipe, or, if it is an edit, from its parents."""

    remotes: Remotes  # where the parents of an edit are looked for, after the cache
    workers: int | None = None  # processes that build; by default one for each core
    progress: bool = True  # whether to show a bar
    held: tuple[Path, ...] = ()
    """Folders that this process holds the locks of, because it makes their datasets."""

    def get(self, request: Request) -> Found | None:
        """Builds the dataset where it belongs; None where nothing says how."""
        folder = request.folder
        if folder is None:
            return None
        if request.recipe is not None:
            build_under_lock(request.recipe, folder, workers=self.workers, progress=self.progress)
            return Found(folder, "rebuilt")
        edit = lost_edit(folder)
        if edit is None:
            return None
        scratch = scratch_folder(folder, "rebuild")
        remove_scratch(scratch)  # of a process that was killed
        try:
            made = self.edited(edit, folder, scratch / edit.id)
            for file in (DATA, RECIPE, REFERENCES, CARD, MANIFEST):  # the manifest makes it whole
                is_kept = file in (REFERENCES, CARD) and os.path.lexists(folder / file)
                if (made / file).exists() and not is_kept:
                    (made / file).replace(folder / file)
            sync(folder)
        finally:
            remove_scratch(scratch)
        return Found(folder, "rebuilt")

    def edited(self, edit: Edit, folder: Path, out: Path) -> Path:
        """Makes an edit again from its parents, which are found as `load` finds them.

        The caller holds the lock of the dataset's folder; the edit is made in `out`.
        """
        from swarmdata.building.edit import rebuild_edit  # noqa: PLC0415  (rarely needed)

        again = replace(self, held=(*self.held, folder.resolve()))
        parents = []
        for parent in {each.id: each for each in edit.parents}.values():
            recipe = shipped_recipe(parent.id)
            request = request_of_id(parent.id) if recipe is None else request_of_recipe(recipe)
            if request.folder is not None and request.folder.resolve() in again.held:
                raise SpecError(f"{edit.id} is made from {parent.id}, which is made from it.")
            try:
                found = obtain(request, self.remotes, again)
            except UnknownNameError as error:
                raise DatasetNotFoundError(
                    f"{edit.id} cannot be made again: one of its parents was not found. {error}"
                ) from error
            parents.append(Dataset.open(found.folder))
        return rebuild_edit(edit, parents, out).path


def obtain(request: Request, remotes: Remotes, rebuild: Rebuild | None = None) -> Found:
    """Returns the dataset from the first source that has it; the last is a build."""
    rebuild = rebuild or Rebuild(remotes, progress=remotes.progress)
    if (found := cached(request)) is not None:
        return found
    request = remotes.pin(request)
    if (found := cached(request)) is not None:
        return found
    folder = request.folder
    can_be_made = folder is not None and (request.recipe or lost_edit(folder))
    if folder is None or not (can_be_made or request.release or remotes.asked):
        raise unknown_dataset(request, remotes)  # without a lock: the cache may be read only
    with locked(folder, remotes.progress):
        # the lock's last holder may have filled the cache
        for get in (cached, remotes.get, rebuild.get):
            if (found := get(request)) is not None:
                remove_scratch(_arriving(folder))  # of killed processes, and of remotes that failed
                remove_scratch(scratch_folder(_arriving(folder), "pull"))
                return found
    raise unknown_dataset(request, remotes)


def unknown_dataset(request: Request, remotes: Remotes) -> UnknownNameError:
    """The error that no source has a dataset, with the command to fetch it from another remote."""
    command = f"swarmdata pull {request.text} --from hf://ORGANIZATION"
    if remotes.offline:
        hint = (
            "It is not in the cache, and no remote was asked. If it is on one, run with a network, "
            f"and without {' and '.join(OFFLINE_VARIABLES)}: {command}"
        )
    else:
        asked = ", ".join(remotes.asked) or "none is configured"
        hint = f"Remotes asked: {asked}. If it is on another one, run: {command}"
    own = {*cached_ids(request.place)} - shipped_recipes().keys()
    known = dict.fromkeys(without_version(key) for key in (*shipped_recipes(), *own))
    return UnknownNameError("dataset", request.text, known, hint=hint)


def obtain_release(remote: Remote, release: Release, folder: Path, progress: bool = True) -> Path:
    """Fetches a release to a folder, where it is not there yet, and returns the folder."""
    refuse_current_folder(folder)
    with locked(folder, progress):  # no other process may build or repair it meanwhile
        if not is_vacant(folder):  # it is compared, and not changed
            pull(remote, release, folder, refuse=refusal(), progress=progress)
        else:
            _arrive(remote, release, folder, refusal(), progress)
    return folder


def refusal(recipe: Recipe | None = None) -> Refusal:
    """A check of manifests on remotes: they must be what their id says, and of the recipe."""

    def refuse(manifest: Manifest) -> str | None:
        identity = judge(manifest)
        if not identity.is_as_named:
            return identity.sentence
        if recipe is not None and manifest.recipe_hash != recipe.hash():
            return f"it is of recipe {manifest.recipe_hash[:12]}, expected {recipe.hash()[:12]}"
        return None

    return refuse


def skip(address: str, what: str, error: SwarmdataError) -> None:
    """Warns that a remote is skipped, and why."""
    message = f"{address} is skipped for {what}: {type(error).__name__}: {error}"
    warnings.warn(message, RemoteSkippedWarning, stacklevel=4)


def _arriving(folder: Path) -> Path:
    return scratch_folder(folder, "arriving")


def _arrive(
    remote: Remote, release: Release, folder: Path, refuse: Refusal, progress: bool
) -> None:
    """Pulls a release beside its place, checks every byte and what it is, and renames it.

    Parts of a build of it that was interrupted there are of no use then, and removed.
    """
    from swarmdata.cards.side_files import finish  # noqa: PLC0415  (all of cards)

    arriving = _arriving(folder)
    remove_scratch(arriving)  # of a process that was killed before it had checked it
    pull(remote, release, arriving, refuse=refuse, progress=progress)
    try:
        origin = open_store(arriving, "full", widths=True).recipe
        finish(arriving)
    except DatasetError as error:
        remove_scratch(arriving)
        problem = without_hint(str(error), arriving).replace(str(arriving), release.address)
        raise type(error)(
            f"{release.address} is no usable dataset: {problem}. Nothing of it is kept. Tell "
            "whoever publishes there."
        ) from error
    except BaseException:
        remove_scratch(arriving)
        raise
    put_in_place(arriving, folder.resolve(), MANIFEST)  # where a link leads, if it is one
    sync(arriving.parent)
    if origin.recipe is not None:
        remove_parts(origin.recipe, folder)
    remove_scratch(arriving)  # at a mount point, an empty folder is left of it


def _newest(name: str, ids: Iterable[str]) -> str | None:
    """The id with the highest version of a name, None if there is none."""
    of_name = [each for each in ids if without_version(each) == name]
    versions = [int(each.rpartition("-v")[2]) for each in of_name]
    return f"{name}-v{max(versions)}" if versions else None
