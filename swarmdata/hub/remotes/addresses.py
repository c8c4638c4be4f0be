"""Addresses such as `hf://org/coop_nav-medium@v1`, and the remotes that the user has configured."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit

import yaml
from platformdirs import user_config_path

from swarmdata.errors import AddressError, SpecError, UnknownNameError
from swarmdata.hub.remotes.interface import Remote
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.locking import locked
from swarmdata.runtime.outside_names import MAX_ID_LENGTH, is_id
from swarmdata.runtime.own_components import ComponentTable, import_component, register

HUB_SCHEMES, FOLDER_SCHEMES, WEB_SCHEMES = ("hf",), ("file",), ("http", "https")
BUCKET_SCHEMES = ("s3", "gs", "gcs", "az", "abfs", "abfss", "memory")
"""Object stores that fsspec knows; each needs its own package, such as s3fs."""

_HOSTS = "swarmdata.hub.remotes.hosts"

REMOTES = ComponentTable(
    "remotes",
    {
        **dict.fromkeys(HUB_SCHEMES, f"{_HOSTS}.hugging_face:HubRemote"),
        **dict.fromkeys(FOLDER_SCHEMES, f"{_HOSTS}.folders:FolderRemote"),
        **dict.fromkeys(WEB_SCHEMES, f"{_HOSTS}.web:WebRemote"),
        **dict.fromkeys(BUCKET_SCHEMES, f"{_HOSTS}.buckets:BucketRemote"),
    },
)
"""Kinds of remotes by the scheme of their addresses."""

_IP_LITERAL = re.compile(r"^\[[0-9A-Fa-f:.]+\]")  # an address of IPv6 in place of a host's name

_HUB_NAME = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9._-]*[A-Za-z0-9_])?")


@dataclass(frozen=True)
class Address:
    """A remote, or one dataset on it."""

    remote: str  # what `open_remote` takes, such as `hf://org` or `s3://bucket/prefix`
    dataset: str | None = None
    """The id with its version, or on a Hub the repository's name, which has none; None: the address
    is of the whole remote."""
    revision: str | None = None  # on a Hub, the tag (`v1`) or the commit; None: the newest version

    def __str__(self) -> str:
        dataset = f"/{self.dataset}" if self.dataset else ""
        return self.remote + dataset + (f"@{self.revision}" if self.revision else "")


def parse_address(text: str) -> Address:
    """Reads the address of a remote or of a dataset on it.

    Raises:
        UnknownNameError: there is no such scheme.
        AddressError: it is malformed.
    """
    scheme, separator, rest = text.partition("://")
    if not separator:
        raise AddressError(
            f"{text.rpartition('@')[2]!r} is not an address, expected one such as 'hf://org', or "
            "'file:///an/absolute/folder' for a folder."
        )
    if scheme not in REMOTES:
        raise UnknownNameError("kind of remote", scheme, REMOTES)
    place = _IP_LITERAL.sub("", rest) if scheme in WEB_SCHEMES else rest
    if re.search(r"[\s\\?#\[\]]|[^\x20-\x7e]", place) or "://" in place or "::" in place:
        raise _malformed(scheme, "it has a space, a query, brackets or characters outside of ASCII")
    is_hub = scheme in HUB_SCHEMES  # whose addresses have a revision after the @, and no port
    if ":" in rest.rpartition("@")[0] if is_hub else "@" in rest.partition("/")[0]:
        raise _malformed(
            scheme, "it has a password. Credentials belong into the environment or a config file"
        )
    if is_hub:
        return _hub_address(rest)
    parts = _split(scheme, text)
    path = parts.path.rstrip("/")
    if any(part in ("", ".", "..") for part in path.split("/")[1:]):
        raise _malformed(scheme, "its path has an empty component or dots")
    if (scheme in FOLDER_SCHEMES) == bool(parts.netloc) or (scheme in FOLDER_SCHEMES and not path):
        raise _malformed(scheme, f"expected {_EXAMPLES.get(scheme, f'{scheme}://bucket/prefix')}")
    head, _, last = path.rpartition("/")
    root = f"{scheme}://{parts.netloc}"
    return Address(root + head, last) if is_id(last) else Address(root + path)


def _split(scheme: str, text: str) -> SplitResult:
    try:
        parts = urlsplit(text)
        _ = parts.port  # checked when it is read
    except ValueError as error:
        raise _malformed(scheme, "expected a host, and a port of at most 65535") from error
    return parts


_EXAMPLES = {
    "hf": "hf://org, hf://org/coop_nav-medium or hf://org/coop_nav-medium@v1",
    "file": "file:///an/absolute/folder",
    "https": "https://host/folder",
    "http": "http://host/folder",
}


def _malformed(scheme: str, problem: str) -> AddressError:
    """Without the address itself, which may hold a password."""
    return AddressError(f"an address of {scheme}:// is malformed: {problem}.")


def _hub_address(rest: str) -> Address:
    place, _, revision = rest.partition("@")
    organization, _, name = place.rstrip("/").partition("/")
    for part in filter(None, (organization, name)):
        if (
            not _HUB_NAME.fullmatch(part)
            or ".." in part
            or "--" in part
            or len(part) > MAX_ID_LENGTH
        ):
            raise _malformed("hf", f"{part!r} is not a name on a Hub. Expected {_EXAMPLES['hf']}")
    revised = "@" in rest
    if not organization or (revised and not (name and re.fullmatch(r"[\w./-]{1,96}", revision))):
        raise _malformed("hf", f"expected {_EXAMPLES['hf']}")
    return Address(f"hf://{organization}", name or None, revision or None)


def open_remote(address: str) -> Remote:
    """Returns the remote at an address; nothing is asked yet.

    Raises:
        UnknownNameError: there is no such scheme.
        AddressError: the address is malformed, or of one dataset.
        MissingExtraError: its package is not installed.
    """
    found = parse_address(address)
    if found.dataset is not None:
        raise AddressError(f"{found} is a dataset, expected a remote such as {found.remote}.")
    kind: Callable[[str], Remote] = import_component(REMOTES[found.remote.partition("://")[0]])
    return kind(found.remote)


def register_remote(scheme: str, remote: Any) -> None:
    """Makes a kind of remote known by the scheme of its addresses.

    Args:
        scheme: such as `sftp`, for `sftp://host/folder`.
        remote: class that implements `hub.remotes.interface.Remote` and is built from an address,
            or "module:Name" of it.

    Raises:
        SpecError: the package has this scheme.
    """
    register("remotes", scheme, remote)


def config_file() -> Path:
    """Where `swarmdata remote add` keeps the remotes."""
    return user_config_path("swarmdata") / "remotes.yaml"


def configured_remotes() -> tuple[str, ...]:
    """The remotes that `load` asks, in order.

    `SWARMDATA_REMOTES`, separated by commas, where it is set, even if empty; else those of the
    user's `remotes.yaml`; else none.
    """
    named = os.environ.get("SWARMDATA_REMOTES")
    if named is None:
        return stored_remotes()
    listed = filter(None, map(str.strip, named.split(",")))
    return tuple(_whole(each, "SWARMDATA_REMOTES") for each in listed)


def stored_remotes() -> tuple[str, ...]:
    """The remotes in the user's `remotes.yaml`, in order; none if there is no such file."""
    path = config_file()
    if not path.exists():
        return ()
    try:
        content = read_document(path)
    except (OSError, SpecError) as error:
        raise AddressError(f"{path} is not YAML: {error}. Correct it, or move it away.") from error
    listed = content.get("remotes") if isinstance(content, dict) else None
    if not isinstance(listed, list) or not all(isinstance(each, str) for each in listed):
        raise AddressError(
            f"{path} has no list of addresses under the key 'remotes'. Correct it, or move it away."
        )
    return tuple(_whole(each, str(path)) for each in listed)


def store_remotes(change: Callable[[tuple[str, ...]], tuple[str, ...]]) -> Path:
    """Changes the user's `remotes.yaml` in one step, while it is locked, and returns its path.

    Where it is a link, what it leads to is changed.
    """
    path = config_file().resolve()
    with locked(path, shown=False):
        text = yaml.safe_dump({"remotes": list(change(stored_remotes()))}, sort_keys=False)
        write_file(path, text.encode())
    return path


def _whole(text: str, where: str) -> str:
    found = parse_address(text)
    if found.dataset is not None:
        raise AddressError(f"{where} names {found}, a dataset. Expected a remote: {found.remote}.")
    return found.remote
