"""Names all damage of a dataset's folder, card included, and replaces only what is broken.

Whatever is fetched or made again must have the SHA-256 in the manifest; a rename swaps it in.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from swarmdata.audit import problems_of
from swarmdata.building.build import build
from swarmdata.cards import side_files
from swarmdata.cards.card import write_card
from swarmdata.errors import (
    DatasetError,
    DatasetNotFoundError,
    ManifestError,
    SpecError,
    SwarmdataError,
)
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.catalog.sources import Rebuild, Remotes, skip
from swarmdata.hub.remotes.addresses import open_remote
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.hub.remotes.pull_dataset import fetch_file, fetch_manifest
from swarmdata.registry.published import changed_versions
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.atomic import sync
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.locking import locked
from swarmdata.specs.origins import Origin, parse_origin
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.specs.origins.foreign_origin import missing_parts
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest, open_store, read_manifest, remove_leftovers, write_file
from swarmdata.store.arrays.layout import CARD, CHECKPOINTS, MANIFEST, RECIPE, REFERENCES
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.damage import Damage, find_damage
from swarmdata.store.recognition import is_dataset, no_dataset, root_attributes
from swarmdata.store.scratch import remove_scratch, scratch_folder

MADE_AGAIN = "made again from the recipe"  # the source of a file that was rebuilt, in words


@dataclass(frozen=True)
class Repair:
    """One repaired file."""

    file: str  # relative to the dataset's folder
    how: str  # where the right bytes came from


def find_blockers(folder: Path) -> tuple[str, ...]:
    """Returns a sentence for each reason why a dataset may not be published anywhere."""
    try:
        problems = problems_of(folder)
        identity = judge(open_store(folder, "none", widths=True).manifest)
    except DatasetError as error:
        return (str(error),)  # nothing else of it can be trusted
    return problems if identity.is_as_named else (*problems, f"{identity.sentence}.")


def examine(path: Path) -> tuple[Damage, ...]:
    """Reads every byte of a dataset and names every broken file, its card included.

    Raises:
        DatasetNotFoundError: there is no such folder.
        FormatVersionError: written by a newer version.
    """
    damage = find_damage(path)
    if not damage:
        return side_files.damage_of(path)
    absent = () if (path / CARD).exists() else (Damage(CARD, "is absent"),)
    return (*damage, *absent)


def repair(
    path: Path, *, remotes: Sequence[str] = (), workers: int | None = None, progress: bool = True
) -> tuple[Repair, ...]:
    """Replaces the broken files of a dataset and leaves the others as they are.

    Only the files that the manifest lists, the manifest and the card are replaced; each is fetched
    from the first of the remotes that has it, or else built. Removed, and named on standard error,
    are temporary files of killed processes and links in the place of a file of the dataset. A
    folder that is no dataset is not touched. The call may be killed at any time and repeated; no
    file is ever half replaced.

    Returns:
        The replaced files and their sources; empty if nothing was broken.

    Raises:
        DatasetNotFoundError: there is no dataset.
        DatasetError: it cannot be repaired; the message says what was tried. Files that could be
            replaced are.
        BuildError: the recipe could not be built.
    """
    if not is_dataset(path):  # before so much as a lock lies there
        raise DatasetNotFoundError(f"{no_dataset(path)} Nothing was changed.")
    with locked(path, progress):
        scratch = scratch_folder(path, "repair")
        job = _Job(path, scratch, tuple(remotes), workers, progress)
        try:
            done = tuple(job.run())
        except DatasetError:  # the rebuild did not help; the next repair goes on after an interrupt
            remove_scratch(scratch)
            raise
        remove_scratch(scratch)
    left = examine(path)
    if left:
        raise DatasetError(
            f"{path} is still damaged after repair: {'; '.join(map(str, left))}. Load it again "
            "elsewhere."
        )
    return done


@dataclass(frozen=True)
class _Job:
    """One repair, whose lock is held, and where it may take things from."""

    path: Path
    scratch: Path
    remotes: tuple[str, ...]
    workers: int | None
    progress: bool

    def run(self) -> Iterator[Repair]:
        remove_leftovers(self.path, MANIFEST, REFERENCES, CARD)
        if any(each.file == MANIFEST for each in find_damage(self.path)):
            restored, how = self._restored()
            self._make_way(MANIFEST)
            write_file(self.path / MANIFEST, restored.to_bytes())
            yield Repair(MANIFEST, how)
        manifest = read_manifest(self.path)
        damage = {each.file for each in find_damage(self.path)}  # links of folders included
        left = [f for f in manifest.files if damage & {f, *map(str, Path(f).parents)}]
        for address in self.remotes if left else ():
            for file in self._fetched(address, manifest, sorted(left)):
                left.remove(file)
                yield Repair(file, f"fetched from {address}")
        for file in self._rebuilt(manifest, sorted(left)) if left else ():
            yield Repair(file, MADE_AGAIN)
        beside = side_files.damage_of(self.path)
        for each in beside:
            self._make_way(each.file)
        if beside:
            write_card(self.path)
        for each in beside:
            yield Repair(each.file, "written anew")

    def _restored(self) -> tuple[Manifest, str]:
        """The first manifest that can be believed, and its source in words."""
        origin, said = self._origin(None), "no manifest of it was found"
        for manifest, how in self._manifests(origin):
            if (doubt := self._doubt(manifest)) is None:
                return manifest, how
            said = doubt
        raise ManifestError(
            f"the manifest of {self.path} cannot be restored: {said}. Take {origin.id} from a "
            "remote. Nothing was changed."
        )

    def _manifests(self, origin: Recipe | Edit) -> Iterator[tuple[Manifest, str]]:
        """Manifests that may be the lost one: of remotes, of the recipe."""
        for address in self.remotes:
            try:
                _, release, manifest = self._offered(address, origin.id)
            except SwarmdataError as error:
                skip(address, f"the manifest of {self.path}", error)
            else:
                yield manifest, f"fetched from {release.address}"
        yield read_manifest(self._built(origin)), MADE_AGAIN

    def _doubt(self, manifest: Manifest) -> str | None:
        """Why a manifest is not believed, in words; None: it is the dataset's."""
        other = next((f for f in manifest.files if not self._is_listed(manifest, f)), None)
        if other is None:
            return None
        if judge(manifest).kind != "published":
            return f"{other} is not the file that {manifest.id} has"
        names = [file for plan in manifest.plan.values() for file in plan.files]
        there = [file for file in names if (self.path / file).is_file()]
        differing = sum(not self._is_listed(manifest, file) for file in there)
        if 2 * differing < len(there):  # else it is a dataset of the user's own
            return None
        return f"{differing} of its {len(there)} arrays are not the published ones"

    def _is_listed(self, manifest: Manifest, file: str) -> bool:
        path = self.path / file
        return path.is_file() and file_digest(path) == manifest.files[file].sha256

    def _offered(self, address: str, dataset: str) -> tuple[Remote, Release, Manifest]:
        """What a remote has under an id: its release, and the manifest of that."""
        remote = open_remote(address)
        release = remote.find(dataset)
        if release is None:
            raise DatasetError(f"{dataset} is not there")
        place = self.scratch / "fetched"
        place.mkdir(parents=True, exist_ok=True)
        return remote, release, fetch_manifest(remote, release, place, lambda manifest: None)

    def _fetched(self, address: str, manifest: Manifest, files: list[str]) -> Iterator[str]:
        """Fetches files from one remote; yields those that have been replaced."""
        try:
            remote, release, theirs = self._offered(address, manifest.id)
            for file in files:
                if theirs.files.get(file) != manifest.files[file]:
                    raise DatasetError(f"{release.address} has another {file} than was written")
                copy = self.scratch / "fetched" / file
                fetch_file(remote, release, manifest, file, copy)
                self._swap(copy, file)
                yield file
        except SwarmdataError as error:
            skip(address, f"the repair of {self.path}", error)

    def _rebuilt(self, manifest: Manifest, files: list[str]) -> Iterator[str]:
        """Builds the dataset again beside this one and takes the broken files out of it."""
        made = self._built(self._origin(manifest))
        wrong = [f for f in files if file_digest(made / f) != manifest.files[f].sha256]
        if wrong:
            changed = changed_versions(manifest.provenance, read_manifest(made).provenance)
            raise DatasetError(
                f"{', '.join(wrong)} of {self.path} cannot be repaired: made again from the recipe "
                f"they have other bytes than were written ({', '.join(changed) or 'same versions'})"
                f". Take them from a remote, or load {manifest.id} again elsewhere."
            )
        for file in files:
            self._swap(made / file, file)
            yield file

    def _built(self, origin: Recipe | Edit) -> Path:
        """Makes a dataset in the scratch folder; what a killed repair has made is used."""
        out = self.scratch / "rebuilt" / origin.id
        if isinstance(origin, Recipe):
            own = self.path if (self.path / CHECKPOINTS).is_dir() else None
            return build(origin, out, checkpoints=own, workers=self.workers, progress=self.progress)
        rebuild = Rebuild(Remotes(self.remotes, False, self.progress), self.workers, self.progress)
        return rebuild.edited(origin, self.path, out)

    def _origin(self, manifest: Manifest | None) -> Recipe | Edit:
        """The origin beside the data if it is whole, else the shipped recipe of the same hash."""
        attributes = root_attributes(self.path)  # which have the hash where the manifest is lost
        known = attributes.get("recipe_hash") if manifest is None else manifest.recipe_hash
        name = attributes.get("id", self.path.resolve().name) if manifest is None else manifest.id
        data: object = None
        beside: Origin | None = None
        try:
            data = read_document(self.path / RECIPE)
            beside = parse_origin(data, RECIPE)
        except (SpecError, OSError, ValueError):  # broken, absent, or of another package
            pass
        if isinstance(beside, Recipe | Edit) and known in (None, beside.hash()):
            return beside
        shipped = shipped_recipes().get(str(name))
        if shipped is None:  # the name may be what is damaged
            recipes = shipped_recipes().values()
            shipped = next((each for each in recipes if each.hash() == known), None)
        if shipped is not None and known in (None, shipped.hash()):
            return shipped
        packages = {} if manifest is None else manifest.provenance
        raise DatasetError(
            f"{self.path} cannot be made again: {_why_lost(beside, missing_parts(data, packages))} "
            f"Take {name} from a remote, or the files from a copy of yours."
        )

    def _make_way(self, file: str) -> None:
        """Removes links where folders of the dataset belong; what is the user's is an error."""
        for folder in (self.path / part for part in reversed(Path(file).parents[:-1])):
            if folder.is_symlink():
                folder.unlink()
                tqdm.write(f"removed {folder}, a link in place of a folder", file=sys.stderr)
            elif folder.exists() and not folder.is_dir():
                raise _in_the_way(folder, "folder", "file")
        if (self.path / file).is_dir() and not (self.path / file).is_symlink():
            raise _in_the_way(self.path / file, "file", "folder")

    def _swap(self, source: Path, file: str) -> None:
        """Puts a checked file in its place."""
        target = self.path / file
        self._make_way(file)
        target.parent.mkdir(parents=True, exist_ok=True)
        sync(source)
        source.replace(target)
        sync(target.parent)


def _in_the_way(path: Path, expected: str, got: str) -> DatasetError:
    return DatasetError(
        f"{path} is a {got}, expected a {expected} of the dataset. It is not part of the dataset, "
        "so it was left: move it away and repair again."
    )


def _why_lost(beside: Origin | None, lacking: str | None) -> str:
    """Why no origin makes a dataset again, a sentence."""
    if beside is not None and not beside.can_rebuild:
        how = beside.remaking or "Nothing makes it again."
        return f"it was recorded, from {beside.source}. {how}"
    if lacking is not None:
        return f"it needs {lacking}."
    what = "absent, broken or no recipe" if beside is None else "not the one it was made from"
    return f"its {RECIPE} is {what}, and the package has no recipe of it."
