"""Names all damage of a dataset's folder, card included, and replaces only what is broken.

A broken file is fetched from a remote or made again from the recipe in a scratch folder, compared
with the SHA-256 in the manifest, and swapped in with one rename. The manifest itself is believed
only where the published digests, or all the other files, agree with it.
"""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.cards import side_files
from swarmdata.cards.render import write_card
from swarmdata.cards.schema import changed_versions
from swarmdata.errors import DatasetError, SwarmdataError
from swarmdata.locking import locked
from swarmdata.remotes.pulling import fetch_file
from swarmdata.resolving import skip
from swarmdata.restoring import MADE_AGAIN, Sources, recipe_of, restore_manifest
from swarmdata.store import (
    Damage,
    Manifest,
    find_damage,
    read_manifest,
    remove_leftovers,
    write_file,
)
from swarmdata.store.atomic import sync
from swarmdata.store.layout import CARD, MANIFEST
from swarmdata.store.reading import links_in
from swarmdata.store.shards import file_digest


@dataclass(frozen=True)
class Repair:
    """One file that is whole again."""

    file: str  # relative to the dataset's folder
    how: str  # where the right bytes came from


def examine(path: Path) -> tuple[Damage, ...]:
    """Reads every byte of a dataset and names every broken file, its card included.

    The card and the references are in no digest: they are compared with what this version of the
    package writes.

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

    Kill it at any time and call again; no file is ever half replaced. A scratch folder
    `<path>.repair` lies beside the dataset meanwhile.

    Args:
        path: the dataset's folder.
        remotes: addresses to fetch from before anything is built.
        workers: processes that build.
        progress: whether to show bars.

    Returns:
        What was replaced, and from where; empty if nothing was broken.

    Raises:
        DatasetError: it cannot be repaired; the message says what was tried. Files that could be
            replaced are.
        BuildError: the recipe could not be built.
    """
    with locked(path, progress):
        scratch = path.with_name(f"{path.name}.repair")
        job = _Job(path, Sources(scratch, tuple(remotes), workers, progress))
        done = tuple(job.run())
        if scratch.exists():
            shutil.rmtree(scratch)
    left = examine(path)
    if left:
        raise DatasetError(
            f"{path} is still damaged after repair: {'; '.join(map(str, left))}. Delete it and "
            "load it again."
        )
    return done


@dataclass(frozen=True)
class _Job:
    """One repair and where it may take things from."""

    path: Path
    sources: Sources

    def run(self) -> Iterator[Repair]:
        remove_leftovers(self.path)
        for link in links_in(self.path):
            (self.path / link).unlink()  # what it points to is not ours; the file is now absent
        damage = {each.file for each in examine(self.path)}
        if MANIFEST in damage:
            restored, how = restore_manifest(self.path, self.sources)
            write_file(self.path / MANIFEST, restored.to_bytes())
            yield Repair(MANIFEST, how)
        manifest = read_manifest(self.path)
        left = [each.file for each in find_damage(self.path)]
        for address in self.sources.remotes:
            for file in self._fetched(address, manifest, left):
                left.remove(file)
                yield Repair(file, f"fetched from {address}")
        if left:
            for file in self._rebuilt_files(manifest, left):
                yield Repair(file, MADE_AGAIN)
        beside = side_files.damage_of(self.path)
        if beside:
            write_card(self.path)
        for each in beside:
            yield Repair(each.file, "written anew")

    def _swap(self, source: Path, file: str) -> None:
        """Puts a checked file in its place."""
        target = self.path / file
        target.parent.mkdir(parents=True, exist_ok=True)
        sync(source)
        source.replace(target)
        sync(target.parent)

    def _fetched(self, address: str, manifest: Manifest, files: Sequence[str]) -> Iterator[str]:
        """Fetches files from one remote; yields those that have been replaced."""
        if not files:
            return
        try:
            remote, release, theirs = self.sources.release(address, manifest.id)
            for file in sorted(files):
                if theirs.files.get(file) != manifest.files[file]:
                    raise DatasetError(f"{release.address} has another {file} than was written")
                copy = self.sources.fetched / file
                fetch_file(remote, release, manifest, file, copy)
                self._swap(copy, file)
                yield file
        except SwarmdataError as error:
            skip(address, f"the repair of {self.path}", error)

    def _rebuilt_files(self, manifest: Manifest, files: Sequence[str]) -> Iterator[str]:
        """Builds the dataset again beside this one and takes the broken files out of it."""
        rebuilt = self.sources.rebuild(recipe_of(self.path, manifest))
        wrong = [f for f in files if file_digest(rebuilt / f) != manifest.files[f].sha256]
        if wrong:
            made = changed_versions(manifest.provenance, read_manifest(rebuilt).provenance)
            raise DatasetError(
                f"{', '.join(wrong)} of {self.path} cannot be repaired: made again from the recipe "
                f"they have other bytes than were written ({', '.join(made) or 'same versions'}). "
                f"Take them from a remote, or delete {self.path} and load {manifest.id} again."
            )
        for file in sorted(files):
            self._swap(rebuilt / file, file)
            yield file
