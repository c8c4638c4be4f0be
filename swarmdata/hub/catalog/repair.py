"""Names all damage of a dataset's folder, card included, and replaces only what is broken.

A broken file is fetched from a remote or made again from the recipe in a scratch folder, compared
with the SHA-256 in the manifest, and swapped in with one rename. The manifest itself is believed
only where the published digests, or all the other files, agree with it.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from swarmdata.cards import side_files
from swarmdata.cards.card import write_card
from swarmdata.errors import DatasetError, DatasetNotFoundError, SwarmdataError
from swarmdata.hub.catalog.repair_sources import MADE_AGAIN, Sources, origin_of, restore_manifest
from swarmdata.hub.catalog.sources import skip
from swarmdata.hub.remotes.pull_dataset import fetch_file
from swarmdata.registry.published import changed_versions
from swarmdata.runtime.atomic import sync
from swarmdata.runtime.locking import locked
from swarmdata.store import Manifest, read_manifest, remove_leftovers, write_file
from swarmdata.store.arrays.layout import CARD, MANIFEST, REFERENCES
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.damage import Damage, find_damage
from swarmdata.store.recognition import is_dataset, no_dataset
from swarmdata.store.scratch import remove_scratch, scratch_folder


@dataclass(frozen=True)
class Repair:
    """One repaired file."""

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

    Only the files that the manifest lists, the manifest and the card are replaced. Removed, and
    named on standard error, are temporary files of killed processes and links in the place of a
    file of the dataset. A folder that is no dataset is not touched. The call may be killed at any
    time and repeated; no file is ever half replaced.

    Args:
        path: the dataset's folder.
        remotes: addresses to fetch from before anything is built.
        workers: processes that build.
        progress: whether to show bars.

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
        job = _Job(path, Sources(path, scratch, tuple(remotes), workers, progress))
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
    """One repair and where it may take things from."""

    path: Path
    sources: Sources

    def run(self) -> Iterator[Repair]:
        remove_leftovers(self.path, MANIFEST, REFERENCES, CARD)
        damage = {each.file for each in examine(self.path)}
        if MANIFEST in damage:
            restored, how = restore_manifest(self.path, self.sources)
            self._make_way(MANIFEST)
            write_file(self.path / MANIFEST, restored.to_bytes())
            yield Repair(MANIFEST, how)
        manifest = read_manifest(self.path)
        left = self._broken_files(manifest)
        for address in self.sources.remotes:
            for file in self._fetched(address, manifest, left):
                left.remove(file)
                yield Repair(file, f"fetched from {address}")
        if left:
            for file in self._rebuilt_files(manifest, left):
                yield Repair(file, MADE_AGAIN)
        beside = side_files.damage_of(self.path)
        for each in beside:
            self._make_way(each.file)
        if beside:
            write_card(self.path)
        for each in beside:
            yield Repair(each.file, "written anew")

    def _broken_files(self, manifest: Manifest) -> list[str]:
        """The listed files that are broken, those in linked folders included."""
        damage = {each.file for each in find_damage(self.path)}
        return [
            file
            for file in sorted(manifest.files)
            if any(part in damage for part in (file, *map(str, Path(file).parents)))
        ]

    def _make_way(self, file: str) -> None:
        """Removes links where folders of the dataset belong; a link for a file is overwritten.

        Raises:
            DatasetError: a file or folder of the user's is in the way. It is not touched.
        """
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
        rebuilt = self.sources.rebuild(origin_of(self.path, manifest))
        wrong = [f for f in files if file_digest(rebuilt / f) != manifest.files[f].sha256]
        if wrong:
            made = changed_versions(manifest.provenance, read_manifest(rebuilt).provenance)
            raise DatasetError(
                f"{', '.join(wrong)} of {self.path} cannot be repaired: made again from the recipe "
                f"they have other bytes than were written ({', '.join(made) or 'same versions'}). "
                f"Take them from a remote, or load {manifest.id} again elsewhere."
            )
        for file in sorted(files):
            self._swap(rebuilt / file, file)
            yield file


def _in_the_way(path: Path, expected: str, got: str) -> DatasetError:
    return DatasetError(
        f"{path} is a {got}, expected a {expected} of the dataset. It is not part of the dataset, "
        "so it was left: move it away and repair again."
    )
