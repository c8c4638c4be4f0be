"""The layout of a stored dataset: its arrays, their dtypes and rows, and the bytes of a shard.

Every array is one Zarr v3 shard of equal, uncompressed chunks, so that the file is the row-major
array, then padding up to a whole chunk, then the shard index. Zarr v3 specification, "sharding
codec", section "binary shard format": per chunk its offset and length as little-endian uint64,
then the CRC-32C of those bytes.
"""

import math
import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from swarmdata.specs.plain_names import is_file_name

FORMAT_VERSION = 1
"""Raised only when an older library would misread the data; new keys and arrays do not raise it."""

DATA, MANIFEST, RECIPE, CARD = "data.zarr", "manifest.json", "recipe.json", "card.md"
"""Names inside a dataset's folder."""

REFERENCES = "references.json"
"""What the reference policies of the task reach, beside the card; only where they were measured."""

CHECKPOINTS = "checkpoints"
"""Folder of the networks that a recipe names and the package does not have."""

CHUNK_ROWS = 10_000
"""Most rows of one chunk; chunks are what the fast checksums cover."""


DType = Literal["bool", "uint8", "int64", "uint64", "float32", "float64"]
"""Names that NumPy and Zarr share."""


@dataclass(frozen=True, slots=True)
class Field:
    """One array: its dtype, what a row is, the names of its axes, and what it means.

    `rows` is `steps` (T per episode), `states` (T + 1 per episode) or `episodes` (1 per episode).
    What its columns mean, `attributes` says.
    """

    dtype: DType
    rows: Literal["steps", "states", "episodes"]
    dimensions: tuple[str, ...]
    meaning: str
    unit: str = ""
    low: float | None = None  # no value is below; None: there is no such bound
    high: float | None = None


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


def _states(dtype: DType, axes: str, meaning: str, *bounds: float) -> Field:
    return Field(dtype, "states", ("state", *axes.split()), meaning, "", *bounds)


def _steps(dtype: DType, axes: str, meaning: str, *bounds: float) -> Field:
    return Field(dtype, "steps", ("step", *axes.split()), meaning, "", *bounds)


def _column(dtype: DType, meaning: str, *bounds: float) -> Field:
    return Field(dtype, "episodes", ("episode",), meaning, "", *bounds)


FIELDS = {
    "observations": _states(
        "float32", "agent observation", "what each agent observed in a state, the last one included"
    ),
    "states": _states(
        "float32", "feature", "the whole state of the world, for training and analysis only"
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

ALL_FIELDS = FIELDS | OPTIONAL_FIELDS

TIME_FIELDS = tuple(name for name, field in FIELDS.items() if field.rows != "episodes")
"""The arrays of every dataset that have rows over time."""


def array_file(name: str, n_dimensions: int) -> str:
    """Path of an array's only shard, relative to the dataset's folder."""
    return f"{DATA}/{name}/c." + ".".join("0" * n_dimensions)


def metadata_file(name: str) -> str:
    """Path of an array's Zarr metadata, relative to the dataset's folder."""
    return f"{DATA}/{name}/zarr.json"


GROUP_FILES = (f"{DATA}/zarr.json", f"{DATA}/episodes/zarr.json")
"""Metadata of the two Zarr groups."""


@dataclass(frozen=True, slots=True)
class Shard:
    """The byte layout of one array's file.

    Args:
        dtype: name of the NumPy and Zarr dtype.
        shape: shape of the array.
        chunk_rows: rows of each chunk.
    """

    dtype: DType
    shape: tuple[int, ...]
    chunk_rows: int

    nbytes: int = field(init=False)  # of the array itself, at the start of the file
    n_chunks: int = field(init=False)  # in the file; none, and no file, without elements
    chunk_bytes: int = field(init=False)  # of each chunk, the padded last one included
    data_bytes: int = field(init=False)  # of all chunks
    file_bytes: int = field(init=False)  # the chunks, 16 bytes of index for each, and a CRC-32C

    def __post_init__(self) -> None:
        """Computes the sizes, once for all who ask."""
        row_bytes = math.prod(self.shape[1:]) * np.dtype(self.dtype).itemsize
        nbytes = self.shape[0] * row_bytes
        n_chunks = -(-self.shape[0] // self.chunk_rows) if nbytes else 0
        chunk_bytes = self.chunk_rows * row_bytes
        data_bytes = n_chunks * chunk_bytes
        file_bytes = data_bytes + 16 * n_chunks + 4
        sizes = (nbytes, n_chunks, chunk_bytes, data_bytes, file_bytes)
        for name, size in zip(_SIZES, sizes, strict=True):
            object.__setattr__(self, name, size)


_SIZES = ("nbytes", "n_chunks", "chunk_bytes", "data_bytes", "file_bytes")
"""Fields of a shard that follow from the others."""


@lru_cache(maxsize=256)
def shard_index(n_chunks: int, chunk_bytes: int) -> bytes:
    """The shard index of chunks that are stored in order and without gaps."""
    numbers = [n for k in range(n_chunks) for n in (k * chunk_bytes, chunk_bytes)]
    table = struct.pack(f"<{len(numbers)}Q", *numbers)
    return table + crc32c(table).to_bytes(4, "little")


class ArrayPlan(NamedTuple):
    """One array in a dataset's folder: the bytes of its file, and what Zarr says of them."""

    shard: Shard
    file: str  # path relative to the folder; there is no file without elements
    metadata_file: str
    metadata: dict[str, Any]  # `expected_metadata`


def plan_arrays(
    arrays: Mapping[str, tuple[DType, tuple[int, ...], int]],
) -> dict[str, ArrayPlan]:
    """Plans all arrays of a dataset.

    Args:
        arrays: dtype, shape and rows of each chunk, by the name of the array.
    """
    shards = {name: Shard(*entry) for name, entry in arrays.items()}
    return {
        name: ArrayPlan(
            shard, array_file(name, len(shard.shape)), metadata_file(name), expected_metadata(shard)
        )
        for name, shard in shards.items()
    }


def expected_files(shards: Mapping[str, Shard]) -> list[str]:
    """Every file of a dataset but the manifest, given its arrays."""
    arrays = [array_file(name, len(s.shape)) for name, s in shards.items() if s.n_chunks]
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
"""Every file that a dataset of this format can have but checkpoints, whose names are the recipe's;
a manifest lists some of them."""


def plan_shard(dtype: DType, shape: tuple[int, ...]) -> Shard:
    """Cuts an array into equal chunks of at most `CHUNK_ROWS` rows, with the least padding."""
    n_chunks = max(1, -(-shape[0] // CHUNK_ROWS))
    return Shard(dtype, shape, max(1, -(-shape[0] // n_chunks)))


def expected_metadata(shard: Shard) -> dict[str, Any]:
    """The parts of `zarr.json` that decide what the bytes of the file mean."""
    chunk = [shard.chunk_rows, *(max(1, size) for size in shard.shape[1:])]
    whole = [chunk[0] * max(1, -(-shard.shape[0] // chunk[0])), *chunk[1:]]
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shard.shape),
        "data_type": shard.dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": whole}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
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
    }


def _bytes_codec(has_order: bool) -> dict[str, Any]:
    little = {"configuration": {"endian": "little"}}
    return {"name": "bytes", **(little if has_order else {})}


@cache
def _crc_table() -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)  # noqa: PLW2901
        table.append(value)
    return tuple(table)


def crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli) of a few kilobytes: RFC 3720, appendix B.4, reflected 0x1EDC6F41.

    Pure Python, because only shard indices (16 bytes per chunk) go through it.
    """
    table, crc = _crc_table(), 0xFFFFFFFF
    for byte in data:
        crc = table[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF
