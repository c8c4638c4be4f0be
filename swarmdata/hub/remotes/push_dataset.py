"""Pushing a dataset: through the gate, then to a remote, all of it or nothing."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmdata.errors import GateError
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.store.manifest import read_manifest


def push(
    folder: Path,
    remote: Remote,
    gate: Callable[[Path], Sequence[str]],
    beside: Callable[[Path, Path], None] | None = None,
) -> Release:
    """Publishes a finished dataset and returns where it is.

    A published version never changes. After an interruption, push again: nothing was visible, and
    what the remote has received already is not sent twice where it can tell.

    Args:
        folder: the dataset's.
        remote: where to.
        gate: returns the reasons against publishing, none if it may be.
        beside: writes more files to publish with it, of the dataset in the first folder into the
            second; see `Remote.publish`.

    Raises:
        GateError: there are reasons; the message lists all of them.
        VersionTakenError: another dataset has this id and version there.
        ConflictError: someone else published to the same place meanwhile.
        HubError: the remote could not be asked, or is read only.
        DatasetError: the manifest cannot be read.
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
