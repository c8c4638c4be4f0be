"""The interface of a remote, and a release, one published dataset on it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable


@dataclass(frozen=True)
class Release:
    """One published (id, version) somewhere."""

    id: str  # with its version, such as `coop_nav-medium-v1`
    address: str
    """Of exactly these files: `hf://org/coop_nav-medium@<commit>`, or the folder
    `s3://bucket/prefix/coop_nav-medium-v1`."""


class Remote(Protocol):
    """Datasets in one place; may be used from several threads at once.

    All methods raise HubError where the remote could not be asked.
    """

    address: str
    """Such as `hf://org`, `s3://bucket/prefix`, `file:///folder`, `https://host/folder`."""

    def find(self, dataset_id: str) -> Release | None:
        """Looks for an exact, versioned id; None if the remote does not have it."""
        ...

    def ids(self) -> tuple[str, ...]:
        """Every id there, sorted."""
        ...

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        """Writes one file of a release that `find` gave to `out`, whose folder exists.

        Nothing is at `out` until all of it has arrived. What was left of an earlier attempt may be
        used, so the caller checks the content. `size` is the most bytes to take, those of the
        manifest where it lists the file.

        Raises:
            AbsentFileError: the release has no such file.
            HubError: it could not be fetched, or is larger.
        """
        ...

    def publish(self, folder: Path, dataset_id: str, beside: Path | None = None) -> Release:
        """Makes a finished dataset visible, all of it or nothing.

        Publishing the same files again changes nothing and returns what is there. `beside` is a
        folder of more files to publish with it, which loading does not need: the Hub's README.md,
        episode tables, Croissant.

        Raises:
            VersionTakenError: another dataset has this id there.
            ConflictError: someone else published to the same place meanwhile.
            HubError: the remote is read only.
        """
        ...


@runtime_checkable
class PartRemote(Remote, Protocol):
    """A remote that also keeps single files, for datasets that are not finished.

    They are in folders that are no id, and so in no list of datasets; `read` gives them, of a
    `Release` whose id is the folder.
    """

    def part_files(self, folder: str) -> tuple[str, ...]:
        """The names of the files in a folder, sorted; none if there is no such folder."""
        ...

    def send_part_file(self, folder: str, name: str, content: bytes) -> None:
        """Writes a file, which appears whole or not at all; one of the same name is replaced."""
        ...


@runtime_checkable
class RangeReader(Protocol):
    """A remote that gives parts of files as well, which streaming needs."""

    def read_range(self, release: Release, file: str, first: int, size: int) -> bytes:
        """Returns `size` bytes of a file of a release, from byte `first` on.

        The file has them, at least 1. The caller checks the content.

        Raises:
            AbsentFileError: the release has no such file.
            HubError: they could not be fetched.
        """
        ...
