"""Manifest, the signed list of everything in a dataset's folder.

The manifest carries its own checksum: the SHA-256 of its bytes with the checksum's 64 digits
written as zeros. So any changed byte of the file shows, and no second file can be lost.
"""

import contextlib
import hashlib
import json
import math
import re
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from swarmdata.errors import (
    ChecksumError,
    DatasetNotFoundError,
    FormatVersionError,
    ManifestError,
    MissingManifestError,
    RecipeConflictError,
    SpecError,
)
from swarmdata.runtime.atomic import is_vacant, write_file
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.runtime.documents import read_document, unique_keys
from swarmdata.specs.origins import parse_origin
from swarmdata.specs.plain_names import Sha256, Text
from swarmdata.specs.recipe import Recipe
from swarmdata.store.arrays.layout import (
    CARD,
    FORMAT_VERSION,
    MANIFEST,
    RECIPE,
    ArrayPlan,
    DType,
    Shard,
    plan_array,
)
from swarmdata.store.recognition import is_dataset, no_dataset
from swarmdata.types import shortened

MAX_MANIFEST_BYTES = 64 << 20
"""A manifest above 64 MiB is refused unread; one of 1,000,000 steps has 30 kB."""

MIN_PAGE_BYTES = 4096
"""Smallest page of a system, and so the least that a file of several is a multiple of."""

_CHECKSUM = re.compile(rb'"checksum": "([0-9a-f]{64})"')
_ZEROS = b'"checksum": "' + b"0" * 64 + b'"'

Size = Annotated[int, Field(ge=0)]
ArrayName = Annotated[str, Field(pattern=r"^(episodes/)?[a-z_]+$")]
Xxh3 = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]


class _Section(BaseModel):
    """Frozen; unknown keys are ignored, which a newer version of the same format wrote."""

    model_config = ConfigDict(
        frozen=True, extra="ignore", strict=True, allow_inf_nan=False, defer_build=True
    )

    def __repr__(self) -> str:
        return shortened(super().__repr__())


class FileEntry(_Section):
    """One file: size in bytes and SHA-256."""

    size: Size
    sha256: Sha256


class ArrayEntry(_Section):
    """One array: what it is, and the xxh3_64 of each chunk's bytes, in order."""

    dtype: DType
    shape: Annotated[tuple[Size, ...], Field(min_length=1, strict=False)]
    chunk_rows: Annotated[int, Field(ge=1)]
    shard_rows: Annotated[int | None, Field(ge=1)] = None  # of each file; absent: all rows
    checksums: Annotated[tuple[Xxh3, ...], Field(strict=False)]

    @property
    def shard(self) -> Shard:
        return Shard(self.dtype, self.shape, self.chunk_rows, self.shard_rows)

    @model_validator(mode="after")
    def _whole_pages(self) -> Self:
        """Several files can only be mapped one after the other if each fills whole pages."""
        if self.shard_rows is not None:
            row_bytes = math.prod(self.shape[1:]) * np.dtype(self.dtype).itemsize
            shard_bytes = self.shard_rows * row_bytes
            if self.shard_rows % self.chunk_rows or shard_bytes % MIN_PAGE_BYTES:
                raise ValueError(
                    f"shard_rows is {self.shard_rows}, expected whole chunks of {self.chunk_rows} "
                    f"rows and a multiple of {MIN_PAGE_BYTES} bytes"
                )
        return self


class StatisticsEntry(_Section):
    """Mean and standard deviation over the train split, agents and time."""

    observation_mean: Annotated[tuple[float, ...], Field(strict=False)]  # [O]
    observation_std: Annotated[tuple[float, ...], Field(strict=False)]  # [O]
    reward_mean: float
    reward_std: float


class Manifest(_Section):
    """Identity, contents and checksums of one dataset."""

    format_version: int
    id: Text
    recipe_hash: Sha256
    n_episodes: Annotated[int, Field(ge=1)]
    n_steps: Annotated[int, Field(ge=1)]
    digest: Sha256  # of the arrays' names, dtypes, shapes and values; see `logical_header`
    arrays: dict[ArrayName, ArrayEntry]
    files: dict[Text, FileEntry]  # every file but the manifest; paths relative to the folder
    statistics: StatisticsEntry
    provenance: dict[Text, Text]  # versions and platform; in no digest

    @cached_property
    def plan(self) -> dict[str, ArrayPlan]:
        """Where each array lies, and what its file and its Zarr metadata must be."""
        return {name: plan_array(name, each.shard) for name, each in self.arrays.items()}

    @property
    def transport_digest(self) -> str:
        """SHA-256 over the lines `<sha256>  <path>` of all `files`, sorted by path, as hex.

        It changes with every byte of every file but the manifest, and so with chunks, metadata and
        the recipe's text, where `digest` changes with values only. In a dataset's folder,
        `sha256sum $(find data.zarr recipe.json -type f | LC_ALL=C sort) | sha256sum` gives it.
        """
        lines = (f"{self.files[path].sha256}  {path}\n" for path in sorted(self.files))
        return hashlib.sha256("".join(lines).encode()).hexdigest()

    def to_bytes(self) -> bytes:
        """The file's content, checksum included."""
        content = {"checksum": "0" * 64, **self.model_dump(mode="json", exclude_none=True)}
        blank = json.dumps(content, indent=1, sort_keys=True, allow_nan=False).encode() + b"\n"
        return blank.replace(_ZEROS, _ZEROS.replace(b"0" * 64, _digest(blank)), 1)


def _digest(blank: bytes) -> bytes:
    return hashlib.sha256(blank).hexdigest().encode()


def repair_hint(folder: Path) -> str:
    """What to do about a dataset that cannot be used; never to delete anything."""
    if not is_dataset(folder):
        return f"{_nothing(folder)} that only a dataset of swarmdata has."
    hint = f"{_repair(folder)} --repair`, which replaces what is broken"
    data = None
    try:
        data = read_document(folder / RECIPE)
        origin = parse_origin(data, RECIPE)
    except (OSError, SpecError):  # broken, absent, or of a package that is not installed
        from swarmdata.specs.origins.foreign_origin import missing_parts  # noqa: PLC0415

        missing = missing_parts(data)
        first = "" if missing is None else f" To make it again, it needs {missing}."
        return f"{hint}, from a remote or as its recipe says.{first}"
    if origin.can_rebuild:
        return f"{hint}, from a remote or made again."
    return (
        f"{hint}, from a remote. Nothing else has these files again, so keep the folder; a "
        "copy of yours may have them."
    )


def file_changed(path: Path, name: str) -> ChecksumError:
    """The error that a file does not have its SHA-256."""
    return ChecksumError(
        f"{path / name} was changed after it was written: its SHA-256 is not the one in the "
        f"manifest. {repair_hint(path)}"
    )


def without_hint(message: str, folder: Path) -> str:
    """The message of an error without its `repair_hint`."""
    for hint in (_repair(folder), _nothing(folder)):
        message = message.partition(hint)[0]
    return message.rstrip(" .")


def _nothing(folder: Path) -> str:
    return f"{folder} has nothing else"


def _repair(folder: Path) -> str:
    return f"Run `swarmdata verify {folder}"


def read_manifest(folder: Path) -> Manifest:
    """Reads and checks `manifest.json`.

    Raises:
        DatasetNotFoundError: the folder is no dataset.
        MissingManifestError: it is one, and has lost its manifest.
        ManifestError: it is not JSON, or lacks or garbles something.
        FormatVersionError: a newer format.
        ChecksumError: it was changed after it was written.
    """
    path = folder / MANIFEST
    try:
        content = path.read_bytes() if path.stat().st_size <= MAX_MANIFEST_BYTES else None
    except (FileNotFoundError, NotADirectoryError) as error:
        if not is_dataset(folder):
            raise DatasetNotFoundError(no_dataset(folder)) from error
        raise MissingManifestError(
            f"{path} is absent, expected the list of the dataset's files: the dataset was never "
            f"finished or the file was lost. {repair_hint(folder)}"
        ) from error
    except OSError as error:  # such as a folder of this name
        raise ManifestError(f"{path} cannot be read: {error.strerror}.") from error
    if content is None:
        raise ManifestError(
            f"{path} has more than {MAX_MANIFEST_BYTES} bytes. {repair_hint(folder)}"
        )
    return parse_manifest(content, path)


def parse_manifest(content: bytes, path: Path) -> Manifest:
    """Checks a manifest's content; `path` is named in errors, the same as `read_manifest`'s."""
    folder = path.parent
    try:
        data = json.loads(content, object_pairs_hook=unique_keys)
    except (ValueError, RecursionError) as error:
        raise ManifestError(f"{path} is not valid JSON: {error}. {repair_hint(folder)}") from error
    found = _CHECKSUM.findall(content)
    if len(found) == 1 and _digest(_CHECKSUM.sub(_ZEROS, content)) != found[0]:
        raise _changed(path)  # before the version, which may be what was changed
    version = data.get("format_version") if isinstance(data, dict) else None
    if not isinstance(version, int) or version < 1:
        raise ManifestError(
            f"{path} has format_version {version!r}, expected an integer from 1. "
            f"{repair_hint(folder)}"
        )
    if version > FORMAT_VERSION:
        raise FormatVersionError(
            f"{path} has format version {version}, this library reads up to {FORMAT_VERSION}. "
            "Upgrade it with: pip install --upgrade swarmdata"
        )
    if len(found) != 1:
        raise _changed(path)
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()[:5]
        )
        raise ManifestError(f"{path} is malformed: {problems}. {repair_hint(folder)}") from error


@lru_cache(maxsize=256)
def recipe_hash(recipe: Recipe) -> str:
    """The hash of a recipe, computed once for all equal ones."""
    return recipe.hash()


class MadeFrom(NamedTuple):
    """Which recipe a dataset is made from."""

    id: str  # the recipe's
    hash: str  # of its content


def check_recipe(folder: Path, manifest: Manifest, expected: MadeFrom) -> None:
    """Raises RecipeConflictError if a dataset was made from another recipe."""
    if manifest.recipe_hash != expected.hash:
        raise RecipeConflictError(
            f"{folder} holds {manifest.id} made from another recipe "
            f"({manifest.recipe_hash[:12]}, expected {expected.hash[:12]} of {expected.id}). "
            "Choose another folder, or move it away."
        )


def is_finished(out: Path, recipe: Recipe) -> bool:
    """Whether a build of a recipe has nothing left to do; what is finished is never written to.

    Raises:
        RecipeConflictError: `out` holds a dataset of another recipe.
        DatasetError: `out` has content and no readable manifest.
    """
    if is_vacant(out):
        return False
    check_recipe(out, read_manifest(out), MadeFrom(recipe.id, recipe_hash(recipe)))
    return (out / CARD).exists()


def note_build(manifest: Manifest) -> None:
    """Records beside the datasets that one was built here, for `was_built_here`."""
    record = _record(manifest)
    with contextlib.suppress(OSError):  # a read-only cache has no such records
        record.parent.mkdir(parents=True, exist_ok=True)
        content = {"id": manifest.id, "digest": manifest.digest, "recipe": manifest.recipe_hash}
        write_file(record, json.dumps(content).encode())


def was_built_here(manifest: Manifest) -> bool:
    """Whether a dataset of these arrays and this recipe was built here."""
    return _record(manifest).is_file()


def _record(manifest: Manifest) -> Path:
    name = f"{manifest.recipe_hash[:32]}-{manifest.digest[:32]}.json"
    return cache_folder() / "built" / name


def _changed(path: Path) -> ChecksumError:
    return ChecksumError(f"{path} was changed after it was written. {repair_hint(path.parent)}")


def logical_header(name: str, dtype: str, shape: tuple[int, ...]) -> bytes:
    """What the logical digest, a SHA-256, takes before the C-order bytes of each array, by name."""
    return f"{name}\n{dtype}\n{','.join(map(str, shape))}\n".encode()
