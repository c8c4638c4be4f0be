"""From the address of a dataset to the release there."""

from collections.abc import Callable, Sequence

from swarmdata.errors import AddressError, HubError, SwarmdataError, did_you_mean
from swarmdata.hub.remotes.addresses import open_remote, parse_address
from swarmdata.hub.remotes.hosts.hugging_face import HubRemote
from swarmdata.hub.remotes.interface import Release, Remote
from swarmdata.specs.plain_names import without_version

PRIVATE = (
    "A Hub says the same of a private dataset: if it is one, log in with `hf auth login`, or set "
    "HF_TOKEN."
)
"""What an absent dataset of a Hub may be instead."""


def locate(address: str) -> tuple[Remote, Release]:
    """Finds the dataset at an address such as `hf://org/coop_nav-medium@v1`.

    On a Hub the revision may be a tag or a commit; without one it is the newest version. Elsewhere
    the last component is the id with its version.

    Raises:
        AddressError: the address is not of a dataset.
        UnknownNameError: it has an unknown scheme.
        HubError: the dataset is not there, or the remote could not be asked.
    """
    found = parse_address(address)
    remote = open_remote(found.remote)
    if found.dataset is None:
        raise AddressError(
            f"{address!r} is a remote, expected a dataset on it such as "
            f"{found.remote}/coop_nav-medium{'' if isinstance(remote, HubRemote) else '-v1'}."
        )
    if isinstance(remote, HubRemote):
        release = remote.at(found.dataset, found.revision)
    else:
        release = remote.find(found.dataset)
    if release is None:
        ids = remote.ids()
        known = [*ids, *(without_version(each) for each in ids)]
        raise HubError(
            f"there is no dataset at {found}."
            f"{did_you_mean(found.dataset, known)} "
            f"`swarmdata remote list {found.remote}` shows what is there."
            f"{f' {PRIVATE}' if isinstance(remote, HubRemote) else ''}"
        )
    return remote, release


def find_release(
    dataset_id: str, addresses: Sequence[str], report: Callable[[str], None] = lambda problem: None
) -> tuple[Remote, Release]:
    """Asks remotes for an exact id, in order, and returns the first that has it.

    `report` is called with what went wrong at a remote that is then passed over.
    """
    failures = []
    for address in addresses:
        try:
            remote = open_remote(address)
            release = remote.find(dataset_id)
        except SwarmdataError as error:
            failures.append(str(error))
            report(failures[-1])
            continue
        if release is not None:
            return remote, release
    asked = ", ".join(addresses) or "none is configured; `swarmdata remote add ADDRESS` adds one"
    if any(address.startswith("hf://") for address in addresses):
        failures.append(PRIVATE)
    raise HubError(f"no remote has {dataset_id} (asked: {asked}). " + " ".join(failures))
