"""Which files a published dataset consists of."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmdata.errors import GateError, HubError, ManifestError, VersionTakenError
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.runtime.outside_names import hostile_names, unsafe_names
from swarmdata.store.arrays.layout import CARD, MANIFEST, REFERENCES, array_files, misplaced_files
from swarmdata.store.manifest import MAX_MANIFEST_BYTES, Manifest, read_manifest

SIDE_FILES = (CARD, REFERENCES)
"""Files beside those that the manifest lists; a release may lack them."""


def published_files(folder: Path, dataset_id: str) -> tuple[str, ...]:
    """Every file of a finished dataset, those of the arrays first and the manifest last."""
    manifest = read_manifest(folder)
    if problems := contradictions(manifest, dataset_id):
        raise ManifestError(f"{folder / MANIFEST} cannot be published: {'; '.join(problems)}.")
    side = [name for name in SIDE_FILES if (folder / name).is_file()]
    return (*sorted(manifest.files), *side, MANIFEST)


def files_to_publish(folder: Path, dataset_id: str, beside: Path | None) -> dict[str, Path]:
    """Every file to publish by its path there, the manifest last."""
    own = {name: folder / name for name in published_files(folder, dataset_id)}
    paths = sorted(beside.rglob("*")) if beside is not None else []
    more = {path.relative_to(str(beside)).as_posix(): path for path in paths if path.is_file()}
    return more | own


def contradictions(manifest: Manifest, dataset_id: str) -> list[str]:
    """What speaks against fetching what the manifest of an id lists, before any is fetched."""
    problems = []
    if manifest.id != dataset_id:
        problems.append(f"it is the manifest of {manifest.id}, not of {dataset_id}")
    if names := unsafe_names([*manifest.files, *SIDE_FILES, MANIFEST]):
        return [*problems, *names]
    shards = {name: entry.shard for name, entry in manifest.arrays.items()}
    if differing := misplaced_files(shards, manifest.files):
        problems.append(f"files {differing} are listed without their array or absent")
    sizes = {
        file: shard.file_bytes(index)
        for name, shard in shards.items()
        for index, file in enumerate(array_files(name, shard))
    }
    for name, entry in manifest.files.items():
        if name in sizes and entry.size != sizes[name]:
            problems.append(f"{name} is listed with {entry.size} bytes, expected {sizes[name]}")
        elif name not in sizes and entry.size > MAX_MANIFEST_BYTES:  # no array's data
            problems.append(
                f"{name} is listed with {entry.size} bytes, expected <= {MAX_MANIFEST_BYTES}"
            )
    return problems


def check_size(file: str, found: int | None, most: int) -> None:
    """Refuses a published file that has, or may have (None), more bytes than its manifest lists."""
    if found is None or found > most:
        raise HubError(
            f"{file} has {found} bytes, expected at most {most:,}. It is not the file that the "
            "manifest lists; tell whoever publishes there."
        )


def version_taken(dataset_id: str, address: str) -> VersionTakenError:
    """The error where another dataset has an id already, at an address."""
    return VersionTakenError(
        f"another {dataset_id} is published at {address}, and a published version never changes. "
        "Publish this one under the next version."
    )


def check_listing(address: str, names: tuple[str, ...]) -> None:
    """Refuses a remote's listing as a whole (HubError) if any name in it is unsafe."""
    problems = hostile_names(names)
    if problems:
        raise HubError(
            f"{address} lists files that no dataset has: {'; '.join(problems[:5])}. Nothing of it "
            "is used; tell whoever publishes there."
        )


def push(
    folder: Path,
    remote: Remote,
    gate: Callable[[Path], Sequence[str]],
    beside: Callable[[Path, Path], None] | None = None,
) -> Release:
    """Publishes a finished dataset and returns where it is.

    `gate` returns the reasons against it. `beside` writes more files to publish with the dataset in
    the first folder into the second.

    Raises:
        GateError: there are reasons; the message lists all of them.
        HubError: as `Remote.publish` says.
    """
    reasons = tuple(gate(folder))
    if reasons:
        listed = "".join(f"\n- {reason}" for reason in reasons)
        raise GateError(
            f"{folder} may not be published to {remote.address}. Nothing was sent:{listed}"
        )
    with TemporaryDirectory() as scratch:
        if beside is not None:
            beside(folder, Path(scratch))
        return remote.publish(folder, read_manifest(folder).id, Path(scratch))
