"""The gate before a push: every reason against publishing a dataset.

What its files and its card say is for the audit to judge; whether it may have this id, and this
version there, is judged here.
"""

import tempfile
from pathlib import Path

from swarmdata.audit import problems_of
from swarmdata.errors import DatasetError, HubError
from swarmdata.hub.catalog.identity import judge
from swarmdata.hub.remotes import Remote
from swarmdata.store import StoredDataset, open_store
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.manifest import MAX_BYTES


def reasons_against(folder: Path, remote: Remote) -> tuple[str, ...]:
    """Every reason against publishing a dataset to a remote; none: it may be published.

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
    """An id of the package means one dataset everywhere."""
    identity = judge(stored.manifest)
    return () if identity.is_as_named else (f"{identity.sentence}.",)


def _of_version(stored: StoredDataset, remote: Remote) -> tuple[str, ...]:
    """A version that is taken stays; the same files under it are no reason, a push ends at once."""
    release = remote.find(stored.manifest.id)
    if release is None:
        return ()
    with tempfile.TemporaryDirectory() as scratch:
        there = Path(scratch, MANIFEST)
        try:
            remote.read(release, MANIFEST, there, MAX_BYTES)
        except HubError as error:
            return (f"the version is taken at {release.address}, and cannot be compared: {error}",)
        if there.read_bytes() == (stored.path / MANIFEST).read_bytes():
            return ()
    return (
        f"the version is taken: {release.address} is another dataset, and a published version never"
        " changes. Publish this one under the next version.",
    )
