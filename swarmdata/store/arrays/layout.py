"""The layout of a stored dataset: its arrays, their dtypes and rows, and the bytes of their files.

Every array is cut into equal, uncompressed chunks in Zarr v3 shards, one file each: the row-major
array, padding up to a whole chunk, the shard index. Arrays above `SHARD_BYTES` have several shards,
whose data fill whole pages of any system: mapped one after the other they are the array again.
"""

import math
import re
import struct
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import google_crc32c
import numpy as np

from swarmdata.runtime import cache_folder
from swarmdata.specs.plain_names import is_file_name

FORMAT_VERSION = 2
"""Newest format that is read, that of arrays in several shards; new keys do not raise it."""

DATA, MANIFEST, RECIPE, CARD = "data.zarr", cache_folder.MANIFEST, "recipe.json", "card.md"
"""Names inside a dataset's folder."""

REFERENCES = "references.json"
"""What the reference policies of the task reach, beside the card; only where they were measured."""

CHECKPOINTS = "checkpoints"
"""Folder of the networks that a recipe names and the package does not have."""

CHUNK_ROWS = 10_000  # most rows of one chunk; chunks are what the fast checksums cover

SHARD_BYTES = 2 << 30
"""Bytes from which an array has several shards; larger than any array of the shipped recipes."""

PAGE_BYTES = 64 << 10  # a multiple of the page size of every system that we know
ABSENT = (1 << 64) - 1  # offset and length, in a shard index, of a chunk that is not there


DType = Literal["bool", "uint8", "int64", "uint64", "float32", "float64"]
"""Names that NumPy and Zarr share."""


@dataclass(frozen=True, slots=True)
class Field:
    """One array: its dtype, what a row is, the names of its axes, and what it means."""

    dtype: DType
    rows: Literal["steps", "states", "episodes"]  # T, T + 1 and 1 per episode
    dimensions: tuple[str, ...]
    meaning: str
    unit: str = ""
    low: float | None = None  # no value is below; None: there is no such bound
    high: float | None = None
    may_be_bytes: bool = field(default=False, kw_only=True)  # uint8, where it holds images

    @property
    def dtypes(self) -> tuple[DType, ...]:
        """The dtypes that the array may have, the usual one first."""
        return (self.dtype, "uint8") if self.may_be_bytes else (self.dtype,)


ROW_MEANINGS = {
    "steps": (
        "one for each joint step: those of episode e are episodes/starts[e] to "
        "episodes/starts[e] + episodes/lengths[e] - 1"
    ),
    "states": (
        "one for each state, one more than steps in each episode: those of episode e are "
        "episodes/starts[e] + e to episodes/starts[e] + e + episodes/lengths[e]. The k-th step of "
        "an episode leads from its k-th state to the next"
    ),
    "episodes": "one for each episode",
}
"""What the rows of an array are, and where an episode's are."""


def _states(dtype: DType, axes: str, meaning: str, *bounds: float, images: bool = False) -> Field:
    names = ("state", *axes.split())
    return Field(dtype, "states", names, meaning, "", *bounds, may_be_bytes=images)


def _steps(dtype: DType, axes: str, meaning: str, *bounds: float) -> Field:
    return Field(dtype, "steps", ("step", *axes.split()), meaning, "", *bounds)


def _column(dtype: DType, meaning: str, *bounds: float) -> Field:
    return Field(dtype, "episodes", ("episode",), meaning, "", *bounds)


FIELDS = {
    "observations": _states(
        "float32",
        "agent observation",
        "what each agent observed in a state, the last one included",
        images=True,
    ),
    "states": _states(
        "float32",
        "feature",
        "the whole state of the world, for training and analysis only",
        images=True,
    ),
    "sent": _states("float32", "agent value", "message that each agent sent in a state"),
    "delivered": _states(
        "bool",
        "agent sender",
        "whether a message of a sender (last axis) arrived at an agent in a state",
    ),
    "ages": _states(
        "uint8",
        "agent sender",
        "control steps since the newest message that an agent has of a sender (last axis) was "
        "sent: 255 if it never had one; 254 also stands for more",
        0,
        255,
    ),
    "actions": _steps("float32", "agent action", "what each agent did"),
    "log_probs": _steps(
        "float32",
        "agent",
        "natural logarithm of the probability (density) of each agent's action under the policy "
        "that made it",
    ),
    "rewards": _steps("float32", "agent", "what each agent got for a step"),
    "terminations": _steps("bool", "", "whether the task ended in a step, for all agents at once"),
    "truncations": _steps("bool", "", "whether the episode was cut after a step, unfinished"),
    "events": _steps("uint8", "agent event", "contacts of each agent in a step", 0, 255),
    "episodes/starts": _column(
        "int64",
        "the episode's first row in the arrays with a row for each step; its first row in those "
        "with a row for each state is starts[e] + e",
        0,
    ),
    "episodes/lengths": _column("int64", "joint steps of the episode", 1),
    "episodes/seeds": _column("uint64", "seed that the episode was reset with", 0),
    "episodes/layouts": Field(
        "float32", "episodes", ("episode", "obstacle", "column"), "the episode's obstacles"
    ),
    "episodes/split": _column("uint8", "split that the episode is in, an index into `codes`"),
    "episodes/end_reason": _column("uint8", "why the episode ended, an index into `codes`"),
    "episodes/policy": _column(
        "uint8", "behavior policy that acted for all agents, an index into `codes`"
    ),
    "episodes/policy_episode": _column(
        "int64", "number of the episode among those that its policy made, from 0", 0
    ),
    "episodes/team_return": _column(
        "float64", "sum over the episode's steps of the mean reward over agents, undiscounted"
    ),
    "episodes/success": _column("bool", "whether the episode ended because the task was solved"),
    "episodes/robot_collisions": _column(
        "int64",
        "contacts between robots that began in the episode. A pair counts once here and in both "
        "robots' rows of events, so this is half the sum of events' robot_onsets; 0 where events "
        "were not recorded",
        0,
    ),
    "episodes/obstacle_collisions": _column(
        "int64",
        "contacts of robots with obstacles and walls that began in the episode: the sum of "
        "events' obstacle_onsets; 0 where events were not recorded",
        0,
    ),
}
"""Arrays of every `data.zarr` by name."""

OPTIONAL_FIELDS = {
    "reward_terms": _steps(
        "float32",
        "agent term",
        "unweighted values of the terms that each agent's reward is made of",
    ),
    "alive": _states("bool", "agent", "whether an agent is in the episode and acts next"),
    "action_masks": _states("bool", "agent choice", "whether an agent may make a choice next"),
    "agent_terminations": _steps("bool", "agent", "whether an agent left because its task ended"),
    "agent_truncations": _steps("bool", "agent", "whether an agent was cut off, unfinished"),
}
"""Arrays that not every dataset has: terms of rewards, those of our tasks; the others, recordings
where agents leave an episode or choices are forbidden."""

LEAVING_ARRAYS = ("agent_terminations", "agent_truncations", "alive")
"""Arrays that a dataset has only if agents leave an episode before its end."""

ALL_FIELDS = FIELDS | OPTIONAL_FIELDS


def common_dtype(name: str, dtypes: Iterable[str]) -> DType:
    """The dtype of an array that joins others: uint8 if all of them are, else the usual one."""
    field = ALL_FIELDS[name]
    return "uint8" if field.may_be_bytes and {*dtypes} == {"uint8"} else field.dtype


TIME_FIELDS = tuple(name for name, field in FIELDS.items() if field.rows != "episodes")
"""The arrays of every dataset that have rows over time."""


def array_file(name: str, n_dimensions: int, shard: int = 0) -> str:
    """Path of a shard of an array, by default the first, relative to the dataset's folder."""
    return f"{DATA}/{name}/c.{shard}" + ".0" * (n_dimensions - 1)


def is_array_file(path: str) -> bool:
    """Whether this is the path of a shard of one of our arrays."""
    folder, _, name = path.rpartition("/")
    array = folder.removeprefix(f"{DATA}/")
    found = re.fullmatch(r"c\.([0-9]+)((?:\.0)*)", name)
    if found is None or array not in ALL_FIELDS:
        return False
    return path == array_file(array, len(ALL_FIELDS[array].dimensions), int(found[1]))


def metadata_file(name: str) -> str:
    """Path of an array's Zarr metadata, relative to the dataset's folder."""
    return f"{DATA}/{name}/zarr.json"


GROUP_FILES = (f"{DATA}/zarr.json", f"{DATA}/episodes/zarr.json")  # metadata of the two Zarr groups


@dataclass(frozen=True, slots=True)
class Shard:
    """The byte layout of one array's files."""

    dtype: DType
    shape: tuple[int, ...]
    chunk_rows: int
    shard_rows: int | None = None  # of each file, whole chunks; None: one file has all rows

    nbytes: int = field(init=False)  # of the array itself, at the start of the data
    n_chunks: int = field(init=False)  # of the array; none, and no file, without elements
    chunk_bytes: int = field(init=False)  # of each chunk, the padded last one included
    data_bytes: int = field(init=False)  # of all chunks
    shard_chunks: int = field(init=False)  # in the index of each file
    n_shards: int = field(init=False)  # files

    def __post_init__(self) -> None:
        row_bytes = math.prod(self.shape[1:]) * np.dtype(self.dtype).itemsize
        nbytes = self.shape[0] * row_bytes
        n_chunks = -(-self.shape[0] // self.chunk_rows) if nbytes else 0
        chunk_bytes = self.chunk_rows * row_bytes
        shard_chunks = n_chunks if self.shard_rows is None else self.shard_rows // self.chunk_rows
        n_shards = -(-n_chunks // shard_chunks) if n_chunks else 0
        sizes = (nbytes, n_chunks, chunk_bytes, n_chunks * chunk_bytes, shard_chunks, n_shards)
        for name, size in zip(_SIZES, sizes, strict=True):
            object.__setattr__(self, name, size)

    def chunks_of(self, shard: int) -> range:
        """The chunks that are in a file."""
        first = shard * self.shard_chunks
        return range(first, min(first + self.shard_chunks, self.n_chunks))

    def rows_of(self, chunk: int) -> tuple[int, int]:
        """First and last row of a chunk; the last chunk may be padded."""
        first = chunk * self.chunk_rows
        return first, min(first + self.chunk_rows, self.shape[0]) - 1

    def data_of(self, shard: int) -> int:
        """Bytes of the chunks in a file."""
        return len(self.chunks_of(shard)) * self.chunk_bytes

    def file_bytes(self, shard: int = 0) -> int:
        """Bytes of a file: the chunks, 16 bytes of index for each, and a CRC-32C."""
        return self.data_of(shard) + 16 * self.shard_chunks + 4

    def index_of(self, shard: int = 0) -> bytes:
        return shard_index(len(self.chunks_of(shard)), self.chunk_bytes, self.shard_chunks)


_SIZES = ("nbytes", "n_chunks", "chunk_bytes", "data_bytes", "shard_chunks", "n_shards")
"""Fields of a shard that follow from the others."""


@lru_cache(maxsize=256)
def shard_index(n_chunks: int, chunk_bytes: int, n_entries: int) -> bytes:
    """The shard index of chunks in order and without gaps; further entries are `ABSENT`.

    Offset and length of each chunk, little-endian uint64, then the CRC-32C of those bytes (Zarr v3
    specification, "sharding codec", section "binary shard format").
    """
    numbers = [n for k in range(n_chunks) for n in (k * chunk_bytes, chunk_bytes)]
    numbers += [ABSENT] * 2 * (n_entries - n_chunks)
    table = struct.pack(f"<{len(numbers)}Q", *numbers)
    return table + google_crc32c.value(table).to_bytes(4, "little")


def format_version(shards: Iterable[Shard]) -> int:
    """The lowest version of the format that can read arrays of these layouts."""
    return 2 if any(shard.shard_rows is not None for shard in shards) else 1


class ArrayPlan(NamedTuple):
    """One array in a dataset's folder: the bytes of its files, and what Zarr says of them."""

    shard: Shard
    files: tuple[str, ...]  # paths relative to the folder; none without elements
    metadata_file: str
    metadata: dict[str, Any]  # `expected_metadata`


def plan_array(name: str, shard: Shard) -> ArrayPlan:
    """Where an array of this layout lies, and what Zarr says of it."""
    return ArrayPlan(shard, array_files(name, shard), metadata_file(name), expected_metadata(shard))


def array_files(name: str, shard: Shard) -> tuple[str, ...]:
    """Paths of an array's files, relative to the dataset's folder; none without elements."""
    return tuple(array_file(name, len(shard.shape), k) for k in range(shard.n_shards))


def expected_files(shards: Mapping[str, Shard]) -> list[str]:
    """Every file of a dataset but the manifest, given its arrays."""
    arrays = [file for name, shard in shards.items() for file in array_files(name, shard)]
    return sorted([RECIPE, *GROUP_FILES, *map(metadata_file, shards), *arrays])


def is_checkpoint_file(path: str) -> bool:
    """Whether this is the path of a network inside a dataset's folder."""
    folder, _, name = path.partition("/")
    return folder == CHECKPOINTS and name.endswith(".safetensors") and is_file_name(name)


def misplaced_files(shards: Mapping[str, Shard], listed: Collection[str]) -> list[str]:
    """The files that a manifest lists without cause, or does not list; checkpoints are optional."""
    own = {path for path in listed if not is_checkpoint_file(path)}
    return sorted(own ^ set(expected_files(shards)))


POSSIBLE_FILES = (
    *(MANIFEST, RECIPE, REFERENCES, CARD, *GROUP_FILES),
    *map(metadata_file, ALL_FIELDS),
    *(array_file(name, len(field.dimensions)) for name, field in ALL_FIELDS.items()),
)
"""Every file that a dataset can have but checkpoints and further shards (`is_array_file`)."""


def plan_shard(dtype: DType, shape: tuple[int, ...]) -> Shard:
    """Cuts an array into equal chunks of at most `CHUNK_ROWS` rows, with the least padding.

    Files have at most `SHARD_BYTES`, unless that is no whole number of pages.
    """
    row_bytes = math.prod(shape[1:]) * np.dtype(dtype).itemsize
    if shape[0] * row_bytes <= SHARD_BYTES:
        n_chunks = max(1, -(-shape[0] // CHUNK_ROWS))
        return Shard(dtype, shape, max(1, -(-shape[0] // n_chunks)))
    most_rows = max(1, SHARD_BYTES // row_bytes)
    chunk_rows = 1 << (min(CHUNK_ROWS, most_rows).bit_length() - 1)
    unit = max(chunk_rows, PAGE_BYTES // math.gcd(row_bytes, PAGE_BYTES))
    return Shard(dtype, shape, chunk_rows, max(1, most_rows // unit) * unit)


def expected_metadata(shard: Shard) -> dict[str, Any]:
    """The parts of `zarr.json` that decide what the bytes of the file mean."""
    chunk = [shard.chunk_rows, *(max(1, size) for size in shard.shape[1:])]
    whole = [shard.shard_rows or chunk[0] * max(1, -(-shard.shape[0] // chunk[0])), *chunk[1:]]
    return {
        "shape": list(shard.shape),
        "data_type": shard.dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": whole}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": np.dtype(shard.dtype).type(0).item(),
        "codecs": [
            {
                "name": "sharding_indexed",
                "configuration": {
                    "chunk_shape": chunk,
                    "codecs": [_bytes_codec(np.dtype(shard.dtype).itemsize > 1)],
                    "index_codecs": [_bytes_codec(True), {"name": "crc32c"}],
                    "index_location": "end",
                },
            }
        ],
        "zarr_format": 3,
        "node_type": "array",
    }


def _bytes_codec(has_order: bool) -> dict[str, Any]:
    little = {"configuration": {"endian": "little"}}
    return {"name": "bytes", **(little if has_order else {})}
