"""The sources of a repair: remotes, a rebuild, and the ways to restore a lost manifest.

A manifest is believed only where the published digests, or all the other files, agree with it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from swarmdata.building.build import build
from swarmdata.errors import DatasetError, ManifestError, SpecError, SwarmdataError
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.sources import Rebuild, Remotes, skip
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.registry.published import Published, published
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.documents import read_document
from swarmdata.specs.origins import Origin, parse_origin
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.specs.origins.foreign_origin import missing_parts
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest, read_manifest
from swarmdata.store.arrays.layout import CHECKPOINTS, MANIFEST, RECIPE
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import MAX_MANIFEST_BYTES, parse_manifest
from swarmdata.store.manifest_recovery import remake_manifest
from swarmdata.store.recognition import root_attributes

MADE_AGAIN = "made again from the recipe"
"""The source of a file that was rebuilt, in words."""


@dataclass(frozen=True)
class Sources:
    """Remotes, the recipe or the parents, and a scratch folder for what comes from them."""

    path: Path  # of the dataset, whose lock is held
    scratch: Path
    remotes: tuple[str, ...]
    workers: int | None
    progress: bool

    @property
    def fetched(self) -> Path:
        """The folder for files of remotes."""
        return self.scratch / "fetched"

    def release(self, address: str, dataset: str) -> tuple[Remote, Release, Manifest]:
        """Finds a dataset on a remote and reads its manifest.

        Raises:
            SwarmdataError: it is not there, or the remote fails.
        """
        remote = open_remote(address)
        release = remote.find(dataset)
        if release is None:
            raise DatasetError(f"{dataset} is not there")
        copy = self.fetched / MANIFEST
        copy.parent.mkdir(parents=True, exist_ok=True)
        remote.read(release, MANIFEST, copy, MAX_MANIFEST_BYTES)
        return remote, release, parse_manifest(copy.read_bytes(), copy)

    def rebuild(self, origin: Recipe | Edit) -> Path:
        """Makes a dataset in the scratch folder; what a killed repair has made is used."""
        out = self.scratch / "rebuilt" / origin.id
        if isinstance(origin, Recipe):
            own = self.path if (self.path / CHECKPOINTS).is_dir() else None
            return build(origin, out, checkpoints=own, workers=self.workers, progress=self.progress)
        rebuild = Rebuild(Remotes(self.remotes, False, self.progress), self.workers, self.progress)
        return rebuild.edited(origin, self.path, out)


def origin_of(path: Path, manifest: Manifest | None) -> Recipe | Edit:
    """The recipe beside the data if it is whole, else the shipped one of the same name and hash.

    An edit has its own beside the data in the place of a recipe.

    The manifest has the hash of the right one. Where the manifest is lost, the attributes of the
    arrays have it; in datasets of older versions they do not, and the recipe or the name must do.

    Raises:
        DatasetError: there is neither.
    """
    attributes = root_attributes(path)
    known = attributes.get("recipe_hash") if manifest is None else manifest.recipe_hash
    name = attributes.get("id", path.resolve().name) if manifest is None else manifest.id
    beside, recipes = _origin_beside(path), shipped_recipes()
    shipped = recipes.get(str(name))
    if shipped is None:  # the name may be what is damaged
        shipped = next((each for each in recipes.values() if each.hash() == known), None)
    for recipe in (beside, shipped):
        if isinstance(recipe, Recipe | Edit) and known in (None, recipe.hash()):
            return recipe
    if beside is not None and not beside.can_rebuild:
        how = beside.remaking or "Nothing makes it again."
        raise DatasetError(
            f"{path} cannot be repaired from here: it was recorded, from {beside.source}. {how} "
            f"Take {name} from a remote, or the files from a copy of yours."
        )
    if manifest is not None and (missing := _missing(path, manifest)) is not None:
        raise DatasetError(f"{path} cannot be made again: it needs {missing}.")
    what = "absent, broken or no recipe" if beside is None else "not the one it was made from"
    raise DatasetError(
        f"{path} cannot be made again: its {RECIPE} is {what}, and the package has no recipe of it"
        f"{f' (SHA-256 {known[:12]})' if isinstance(known, str) else ''}. Take {name} from a "
        f"remote, or its {RECIPE} from a copy."
    )


def _origin_beside(path: Path) -> Origin | None:
    """The origin in a dataset's folder, None where it is broken or absent."""
    try:
        return parse_origin(read_document(path / RECIPE), RECIPE)
    except (SpecError, OSError, ValueError):
        return None


def _missing(path: Path, manifest: Manifest) -> str | None:
    """What its recipe names and nothing here defines."""
    try:
        return missing_parts(read_document(path / RECIPE), manifest.provenance)
    except (SpecError, OSError, ValueError):
        return None


def restore_manifest(path: Path, sources: Sources) -> tuple[Manifest, str]:
    """Finds the manifest of a dataset that has lost it, or has a broken one.

    In this order: one made from the files themselves, if they have the published digests; a
    remote's; that of the recipe built again. The latter two must have the published digest or,
    where none is published, list every file as it is here.

    Returns:
        The manifest, and its source in words.

    Raises:
        DatasetError: no manifest can be believed.
        BuildError: the recipe could not be built.
    """
    recipe = origin_of(path, None)
    entry = published().get(recipe.id)
    if entry is None or isinstance(recipe, Edit) or entry.recipe_hash != recipe.hash():
        return _of_unpublished(path, recipe, sources)
    if (own := _from_files(path, recipe, entry)) is not None:
        return own, "made again from files that have the published digests"
    for theirs, address in _offers(path, recipe.id, sources):
        if judge(theirs).kind == "published":
            return _of_most_files(path, theirs), f"fetched from {address}"
    rebuilt = read_manifest(sources.rebuild(recipe))
    identity = judge(rebuilt)
    if identity.kind != "published":
        raise ManifestError(
            f"the manifest of {path} cannot be restored: it was made again from the recipe, and "
            f"{identity.sentence}. Take {recipe.id} from a remote. Nothing was changed."
        )
    return _of_most_files(path, rebuilt), MADE_AGAIN


def _of_most_files(path: Path, manifest: Manifest) -> Manifest:
    """The manifest, if most arrays here are those that it lists.

    Where most are others, this is a dataset of the user's own, whatever its name: none of its
    files may be replaced.

    Raises:
        ManifestError: most are others.
    """
    names = [file for plan in manifest.plan.values() for file in plan.files]
    there = [file for file in names if file in manifest.files and (path / file).is_file()]
    same = sum(file_digest(path / file) == manifest.files[file].sha256 for file in there)
    if 2 * same > len(there):
        return manifest
    raise ManifestError(
        f"the manifest of {path} cannot be restored: {len(there) - same} of its {len(there)} "
        f"arrays are not those of the published {manifest.id}, so this is another dataset, or too "
        "little is left of it. Nothing was changed."
    )


def _offers(path: Path, dataset: str, sources: Sources) -> Iterator[tuple[Manifest, str]]:
    """The manifests that remotes have under an id, with the addresses of their releases."""
    for address in sources.remotes:
        try:
            _, release, theirs = sources.release(address, dataset)
        except SwarmdataError as error:
            skip(address, f"the manifest of {path}", error)
        else:
            yield theirs, release.address


def _from_files(path: Path, recipe: Recipe, entry: Published) -> Manifest | None:
    """A manifest of the files here, None unless they are exactly the published ones."""
    try:
        own = remake_manifest(path, recipe, entry.made_with)
    except DatasetError:
        return None
    is_whole = own.transport_digest == entry.transport_digest
    return own if is_whole and judge(own).kind == "published" else None


def _of_unpublished(path: Path, recipe: Recipe | Edit, sources: Sources) -> tuple[Manifest, str]:
    """A remote's manifest or that of the recipe built again, if every file here is in it."""
    for theirs, address in _offers(path, recipe.id, sources):
        if _other_file(path, theirs) is None:
            return theirs, f"fetched from {address}"
    rebuilt = read_manifest(sources.rebuild(recipe))
    if (file := _other_file(path, rebuilt)) is not None:
        raise ManifestError(
            f"the manifest of {path} cannot be restored: no digest of {recipe.id} with this recipe "
            f"is published, and {file} is not what its recipe makes here. Nothing was changed."
        )
    return rebuilt, MADE_AGAIN


def _other_file(path: Path, manifest: Manifest) -> str | None:
    """The first file here that is not the one that a manifest lists."""
    for file, entry in manifest.files.items():
        if not (path / file).is_file() or file_digest(path / file) != entry.sha256:
            return file
    return None
