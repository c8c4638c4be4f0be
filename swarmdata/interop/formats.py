"""Format: how to read and write a foreign format; and the table of formats by name."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.registry.components import resolve

FORMATS = {
    "d4rl": "swarmdata.interop.d4rl:FORMAT",
    "d4rl-agents": "swarmdata.interop.d4rl_agents:FORMAT",
    "lerobot": "swarmdata.interop.lerobot:FORMAT",
    "mcap": "swarmdata.interop.bags.bag_formats:MCAP",
    "minari": "swarmdata.interop.minari:FORMAT",
    "numpy": "swarmdata.interop.numpy_folders:FORMAT",
    "parquet": "swarmdata.interop.parquet:FORMAT",
    "rosbag2": "swarmdata.interop.bags.bag_formats:ROSBAG2",
    "torchrl": "swarmdata.interop.torchrl.torchrl:FORMAT",
    "vault": "swarmdata.interop.vault:FORMAT",
}

Reader = Callable[[Path, str, Choices], AbstractContextManager[ImportedData]]
"""Opens foreign data, given its path, the task's name if the data have none, and the choices."""

Writer = Callable[[Dataset, Path, str], None]
"""Writes a view, given the path, which does not exist yet, and the frame that the data are in."""


@dataclass(frozen=True, slots=True)
class Format:
    """One foreign format."""

    name: str  # key in `FORMATS`
    title: str  # name for people
    kept: Mapping[str, str]  # facts that an export keeps, and under which name; see `DATASET_FACTS`
    lost: Mapping[str, str]  # facts that an export loses, and why
    read: Reader | None  # None: the format can only be written
    write: Writer
    misplaced: Callable[[Dataset, Path], str | None] | None = None
    """Says why the format's own library does not find the export of a view at a path."""


def find_format(name: str) -> Format:
    """Imports the format `name`, or raises UnknownNameError."""
    found: Format = resolve("format", FORMATS, name)
    return found


def all_formats() -> Iterator[Format]:
    """Every format, in the order of the names."""
    return (find_format(name) for name in sorted(FORMATS))
