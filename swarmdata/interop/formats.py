"""Format, what a file of this folder gives, and the formats by name as a literal table."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.incoming import Incoming
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.registry.components import resolve

FORMATS = {
    "d4rl": "swarmdata.interop.d4rl.d4rl:FORMAT",
    "d4rl-agents": "swarmdata.interop.d4rl.d4rl_agents:FORMAT",
    "minari": "swarmdata.interop.minari:FORMAT",
    "numpy": "swarmdata.interop.numpy_folders:FORMAT",
    "parquet": "swarmdata.interop.parquet.parquet:FORMAT",
    "torchrl": "swarmdata.interop.torchrl.torchrl:FORMAT",
    "vault": "swarmdata.interop.vault:FORMAT",
}

Reader = Callable[[Path, str, Choices], AbstractContextManager[Incoming]]
"""Opens foreign data: where it is, the task's name where it has none, and the user's choices."""

Writer = Callable[[Dataset, Path], None]
"""Writes a view to a path at which nothing is yet."""


@dataclass(frozen=True, slots=True)
class Format:
    """One foreign format.

    Attributes:
        name: in `FORMATS`.
        title: for people.
        kept: facts that an export keeps, and under which name; see `fields.FACTS`.
        lost: facts that it does not keep, and why.
        read: opens it, None where the format is only written.
        write: writes it, None where it is only read.
    """

    name: str
    title: str
    kept: Mapping[str, str]
    lost: Mapping[str, str]
    read: Reader | None
    write: Writer | None


def find_format(name: str) -> Format:
    """Imports the format `name`.

    Raises:
        UnknownNameError: with the nearest known name.
    """
    found: Format = resolve("format", FORMATS, name)
    return found


def all_formats() -> Iterator[Format]:
    """Every format, in the order of the names."""
    return (find_format(name) for name in sorted(FORMATS))
