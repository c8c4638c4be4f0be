"""What blocks a dataset from being published: all that is checked before a push.

The audit judges its files and its card. Whether it may have this id, and whether the remote has
another dataset of this version already, is judged here.
"""

import tempfile
from pathlib import Path

from swarmdata.audit import problems_of
from swarmdata.errors import DatasetError, HubError
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.remotes.interface import Remote
from swarmdata.store import StoredDataset, open_store
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.manifest import MAX_MANIFEST_BYTES


def find_blockers(folder: Path, remote: Remote) -> tuple[str, ...]:
    """Returns a sentence for each reason why a dataset may not be published to a remote.

    Args:
        folder: the dataset's; every byte of it is read and compared with its manifest.
        remote: where to.

    Raises:
        HubError: the remote could not be asked whether the version is taken.
    """
    try:
        problems = problems_of(folder)
        stored = open_store(folder, "none", widths=True)
    except DatasetError as error:
        return (str(error),)  # nothing else of it can be trusted
    return (*problems, *_of_identity(stored), *_of_version(stored, remote))


def _of_identity(stored: StoredDataset) -> tuple[str, ...]:
    """An id of the package means the same dataset everywhere."""
    identity = judge(stored.manifest)
    return () if identity.is_as_named else (f"{identity.sentence}.",)


def _of_version(stored: StoredDataset, remote: Remote) -> tuple[str, ...]:
    """A published version never changes; to push the same files again is allowed."""
    release = remote.find(stored.manifest.id)
    if release is None:
        return ()
    with tempfile.TemporaryDirectory() as scratch:
        there = Path(scratch, MANIFEST)
        try:
            remote.read(release, MANIFEST, there, MAX_MANIFEST_BYTES)
        except HubError as error:
            return (f"the version is taken at {release.address}, and cannot be compared: {error}",)
        if there.read_bytes() == (stored.path / MANIFEST).read_bytes():
            return ()
    return (
        f"the version is taken: {release.address} is another dataset, and a published version never"
        " changes. Publish this one under the next version.",
    )
