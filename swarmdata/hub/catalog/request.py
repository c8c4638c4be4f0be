"""Request, the dataset that `load` is asked for: an id, an address or a folder, read once."""

import hashlib
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from swarmdata.errors import AddressError, DatasetNotFoundError, SpecError, UnknownNameError
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe, versions_of
from swarmdata.runtime.atomic import is_vacant
from swarmdata.runtime.cache_folder import cache_folder, offline_variable
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.outside_names import is_address, is_folder, is_id, looks_like_path
from swarmdata.specs.origins import parse_origin
from swarmdata.specs.recipe import Recipe
from swarmdata.store.arrays.layout import CARD, DATA, MANIFEST, RECIPE
from swarmdata.store.manifest import MadeFrom, is_finished, read_manifest, recipe_hash
from swarmdata.store.recognition import no_folder

if TYPE_CHECKING:  # what is in the cache needs no remote
    from swarmdata.hub.remotes.addresses import Address
    from swarmdata.hub.remotes.interface import Release, Remote
    from swarmdata.specs.origins.edit_origin import Edit


@dataclass(frozen=True)
class Request:
    """One request for a dataset."""

    text: str  # the name that was asked for, as it was written
    place: Path  # the folder in which the versions of the dataset lie, each in a folder of its own
    folder: Path | None
    """The dataset's own folder; None: only a remote knows which version is the newest."""
    source: Literal["cache", "folder"] = "cache"
    """What the dataset's source is called where it is in `folder` already."""
    made_from: MadeFrom | None = None  # the recipe that makes it, if the package has one
    make_recipe: Callable[[], Recipe] | None = None
    """Returns that recipe, which takes longer than to open a dataset of it."""
    address: "Address | None" = None  # of the dataset, if `text` is one
    release: "tuple[Remote, Release] | None" = None
    """At that address, once the remote has been asked."""

    @property
    def recipe(self) -> Recipe | None:
        return None if self.make_recipe is None else self.make_recipe()


@dataclass(frozen=True)
class Found:
    """A finished dataset and where it came from."""

    folder: Path
    source: str  # `cache`, `folder`, `rebuilt`, or the release's address


def cached(request: Request) -> Found | None:
    """The dataset where it belongs on this machine, if it is there and finished.

    Which recipe a finished dataset was made from is for `open_store` to compare.
    """
    folder = request.folder
    if folder is None or lost_edit(folder) is not None:
        return None
    if request.make_recipe is not None:
        is_there = (folder / CARD).exists() or is_finished(folder, request.make_recipe())
    elif request.source == "folder":  # `open_store` says whether it is a dataset
        is_there = True
    else:
        is_there = not is_vacant(folder) and bool(read_manifest(folder))
    return Found(folder, request.source) if is_there else None


def lost_edit(folder: Path) -> "Edit | None":
    """The edit whose `recipe.json` is all that is left of the dataset in a folder.

    None where there are arrays or a manifest, damaged or not: `repair` handles those.
    """
    if any(os.path.lexists(folder / name) for name in (MANIFEST, DATA)):
        return None
    try:
        origin = parse_origin(read_document(folder / RECIPE), RECIPE)
    except (OSError, SpecError):  # absent, or a file of the user's
        return None
    return cast("Edit", origin) if origin.kind == "edit" else None


def parse_request(name: str | Path, path: Path | str | None = None) -> Request:
    """Reads a name as `load` takes it; of the disk only folders of this name are looked at.

    The id of a shipped recipe takes precedence over a folder of the same name. `path` is the folder
    of a shipped dataset that shall not be in the cache.
    """
    for each in (name, path):
        if each is not None and not str(each).strip():
            raise AddressError(
                f"the name of a dataset is {str(each)!r}, expected an id such as "
                "'coop_nav-medium', an address or a folder; the current folder is '.'."
            )
    folder = None if path is None else Path(path)
    if isinstance(name, str):
        if (dataset_id := _published_id(name)) is not None:
            made_from = MadeFrom(dataset_id, published()[dataset_id].recipe_hash)
            return _request_of(made_from, partial(find_recipe, dataset_id), folder)
        if (recipe := shipped_recipe(name)) is not None:
            return request_of_recipe(recipe, folder)
    if path is not None:
        raise SpecError(
            f"path is where the dataset of a shipped id is or shall be, got it with {str(name)!r}. "
            "Leave it out."
        )
    if isinstance(name, str) and is_address(name):
        return request_of_address(name)
    if is_folder(name):
        return Request(str(name), Path(name).parent, Path(name), "folder")
    if isinstance(name, Path) or looks_like_path(name):
        raise DatasetNotFoundError(no_folder(name))
    return request_of_id(name)


def shipped_recipe(name: str) -> Recipe | None:
    """The shipped recipe of an id, None if there is none."""
    try:
        return find_recipe(name)
    except UnknownNameError:
        return None


def request_of_recipe(recipe: Recipe, folder: Path | None = None) -> Request:
    """Asks for the dataset of a recipe, by default in the cache."""
    return _request_of(MadeFrom(recipe.id, recipe_hash(recipe)), lambda: recipe, folder)


def _request_of(
    made_from: MadeFrom, make_recipe: Callable[[], Recipe], folder: Path | None
) -> Request:
    if folder is not None:
        return Request(made_from.id, folder.parent, folder, "folder", made_from, make_recipe)
    place = cache_folder() / "datasets"
    return Request(
        made_from.id, place, place / made_from.id, made_from=made_from, make_recipe=make_recipe
    )


def _published_id(name: str) -> str | None:
    """The id of a published dataset, with its version; None if there is none."""
    return next((each for each in versions_of(name) if each in published()), None)


def request_of_id(name: str) -> Request:
    """Asks for a dataset that no shipped recipe makes; without a version, for the newest."""
    place = cache_folder() / "datasets"
    return Request(name, place, place / name if is_id(name) else None)


def request_of_address(text: str) -> Request:
    """Asks for the dataset at an address such as `hf://org/coop_nav-medium@v1`."""
    from swarmdata.hub.remotes.addresses import parse_address  # noqa: PLC0415

    address = parse_address(text)
    place = cache_folder() / "remotes" / _slug(address.remote)
    name = _pinned(address)
    return Request(text, place, place / name if name else None, address=address)


def is_offline(wanted: bool | None = None) -> bool:
    """Whether no remote is asked, as the caller wants or the environment says."""
    return bool(wanted) or offline_variable() is not None


def _pinned(address: "Address") -> str | None:
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
