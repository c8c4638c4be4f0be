"""Opens a dataset as memory maps, after checking that the bytes are those that were written."""

import hashlib
import json
import math
import os
import stat
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import (
    ChecksumError,
    DatasetNotFoundError,
    ManifestError,
    MissingFileError,
    SpawnError,
    SpecError,
    TruncatedFileError,
)
from swarmdata.runtime.documents import MAX_JSON_BYTES, parse_json
from swarmdata.runtime.mapped_pages import mapping_of, release_pages
from swarmdata.specs.origins import Origin, parse_origin
from swarmdata.store.arrays.layout import (
    ALL_FIELDS,
    CHECKPOINTS,
    FIELDS,
    GROUP_FILES,
    POSSIBLE_FILES,
    RECIPE,
    is_array_file,
    is_checkpoint_file,
    misplaced_files,
)
from swarmdata.store.arrays.mapped_files import map_array
from swarmdata.store.arrays.row_shapes import MAY_BE_EMPTY, row_shapes
from swarmdata.store.manifest import (
    MadeFrom,
    Manifest,
    check_recipe,
    file_changed,
    read_manifest,
    repair_hint,
)
from swarmdata.store.recognition import linked_hint, links_in, no_folder, root_attributes
from swarmdata.store.table import SPLITS, EpisodeTable
from swarmdata.types import END_REASONS, shortened

Verify = Literal["none", "fast", "full"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StoredDataset:
    """An open dataset: read-only memory maps and the episode table."""

    path: Path
    manifest: Manifest
    recipe: Origin
    arrays: dict[str, NDArray[Any]]
    table: EpisodeTable

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the path and what is in no file of it: a worker process maps the files itself."""
        return reopen_store, (self.path, self.manifest.digest, self.computed())

    def computed(self) -> dict[str, NDArray[Any]]:
        """The arrays that are in no file of the dataset; an empty one costs nothing to copy."""
        return {name: array for name, array in self.arrays.items() if _is_computed(array)}

    def rows(self, number: int, name: str) -> NDArray[Any]:
        """Returns the rows of an array in an episode, a view of the memory map."""
        extra = ALL_FIELDS[name].rows == "states"
        first = int(self.table.starts[number]) + extra * number
        return self.arrays[name][first : first + int(self.table.lengths[number]) + extra]

    def with_arrays(self, computed: Mapping[str, NDArray[Any]]) -> "StoredDataset":
        """The same dataset with other arrays, and with their columns in its episode table."""
        columns = {
            name.split("/")[1]: array
            for name, array in computed.items()
            if name.startswith("episodes/")
        }
        arrays = {**self.arrays, **computed}
        return replace(self, arrays=arrays, table=replace(self.table, **columns))

    def __repr__(self) -> str:
        table = f"{len(self.table):,} episodes, {self.manifest.n_steps:,} steps"
        arrays = f"{len(self.arrays)} arrays"
        return shortened(f"<StoredDataset {self.manifest.id}: {table}, {arrays}, at {self.path}>")


def open_store(
    path: Path, verify: Verify = "fast", *, widths: bool = False, made_from: MadeFrom | None = None
) -> StoredDataset:
    """Opens a dataset's folder.

    Args:
        path: the folder.
        verify: `fast` checks every chunk and small file at memory speed, `full` also the SHA-256
            of every file and the logical digest, `none` only names, sizes, metadata, the episode
            table and the spec.
        widths: whether observations, states, messages and layouts of a task are compared with the
            spec as well; that takes the task's code. The team and its actions, and all sizes of a
            recording, are always compared.
        made_from: the recipe that the dataset must have been made from; None: any.

    Raises:
        RecipeConflictError: the dataset is of another recipe.
        DatasetError: one of its subclasses, which names the file and says what to do.
    """
    if verify not in ("none", "fast", "full"):
        raise ValueError(f"verify is {verify!r}, expected 'none', 'fast' or 'full'")
    if not path.is_dir():
        raise DatasetNotFoundError(no_folder(path))
    for link in blocking_links(path):  # it could show any file of this machine as data
        raise ManifestError(
            f"{path / link} is a symbolic link, expected a plain file or folder."
            f"{linked_hint(path) or f' {repair_hint(path)}'}"
        )
    manifest = read_manifest(path)
    if made_from is not None:
        check_recipe(path, manifest, made_from)
    check_listing(path, manifest)
    _check_sizes(path, manifest)
    small_files = _read_small_files(path, manifest, is_checked=verify != "none")
    _check_metadata(path, manifest, small_files)
    raw = {name: map_checked(path, manifest, name) for name in manifest.arrays}
    if verify != "none":
        _check_chunks(path, manifest, raw)
    if verify == "full":
        from swarmdata.store.damage import check_everything  # noqa: PLC0415

        check_everything(path, manifest, raw)
    arrays = {
        name: raw[name][: shard.nbytes].view(np.dtype(shard.dtype)).reshape(shard.shape)
        for name, (shard, *_) in manifest.plan.items()
    }
    origin = read_origin(path, manifest, small_files[RECIPE])
    check_spec(path, manifest, origin, widths=widths)
    table = read_table(path, manifest, origin, arrays)
    return StoredDataset(path, manifest, origin, arrays, table)


def _is_computed(array: NDArray[Any]) -> bool:
    """Whether an array is in no file of the dataset."""
    from swarmdata.store.arrays.scratch_arrays import ScratchMap  # noqa: PLC0415  (to pickle)

    mapped = mapping_of(array)
    return mapped is None or isinstance(mapped, ScratchMap)


def reopen_store(path: Path, digest: str, computed: Mapping[str, NDArray[Any]]) -> StoredDataset:
    """Opens a dataset that another process has verified, with arrays that are in no file of it.

    Raises:
        ChecksumError: another dataset is there now.
    """
    stored = open_store(path, "none")
    if stored.manifest.digest != digest:
        raise ChecksumError(
            f"{path} has digest {stored.manifest.digest}, it had {digest} when it was pickled: it "
            "was replaced meanwhile. Load it again."
        )
    return stored.with_arrays(computed)


def blocking_links(path: Path) -> tuple[str, ...]:
    """The links below a dataset's folder where a file or folder of the dataset belongs, sorted.

    The user's own links elsewhere in the folder are never followed, and do no harm.
    """
    found = links_in(path)
    if not found:
        return ()
    ours = {file.parts[:n] for file in map(Path, POSSIBLE_FILES) for n in range(1, 9)}
    return tuple(
        link
        for link in found
        if Path(link).parts in ours
        or link == CHECKPOINTS
        or is_checkpoint_file(link)
        or is_array_file(link)
    )


def check_listing(path: Path, manifest: Manifest) -> None:
    """Checks that what the manifest lists can be a dataset (ManifestError); reads no other file."""
    _check_arrays(path, manifest)
    _check_files(path, manifest)


def _check_arrays(path: Path, manifest: Manifest) -> None:
    """Checks the listed arrays against the format and against each other."""
    rows = {
        "steps": manifest.n_steps,
        "states": manifest.n_steps + manifest.n_episodes,
        "episodes": manifest.n_episodes,
    }
    absent = sorted(set(FIELDS) - set(manifest.arrays))
    if absent:
        raise _disagrees(path, manifest, f"arrays {absent} are not listed")
    for name, (shard, *_) in manifest.plan.items():
        n_checksums = len(manifest.arrays[name].checksums)
        if n_checksums != shard.n_chunks:
            problem = f"{n_checksums} checksums for {shard.n_chunks} chunks"
            raise _disagrees(path, manifest, f"array {name!r} is listed with {problem}")
        if shard.shard_chunks > shard.n_chunks:
            problem = f"files of {shard.shard_rows} rows, it has {shard.shape[0]}"
            raise _disagrees(path, manifest, f"array {name!r} is listed with {problem}")
    for name, field in ALL_FIELDS.items():
        if name not in manifest.arrays:
            continue
        entry = manifest.arrays[name]
        got = (entry.dtype, len(entry.shape), entry.shape[0])
        dtype = entry.dtype if entry.dtype in field.dtypes else field.dtype
        expected = (dtype, len(field.dimensions), rows[field.rows])
        if got != expected:
            problem = f"listed with (dtype, dimensions, rows) {got}, expected {expected}"
            raise _disagrees(path, manifest, f"array {name!r} is {problem}")


def _check_files(path: Path, manifest: Manifest) -> None:
    """Checks that exactly the files of the arrays are listed, with the sizes of the arrays."""
    shards = {name: plan.shard for name, plan in manifest.plan.items()}
    differing = misplaced_files(shards, manifest.files)
    if differing:
        raise _disagrees(
            path, manifest, f"files {differing} are listed without their array or absent"
        )
    for shard, files, *_ in manifest.plan.values():
        for index, file in enumerate(files):
            size, expected = manifest.files[file].size, shard.file_bytes(index)
            if size != expected:
                raise _disagrees(
                    path,
                    manifest,
                    f"{file} is listed with {size} bytes, but an array of shape {shard.shape} and "
                    f"dtype {shard.dtype} has {expected}",
                )


def _check_sizes(path: Path, manifest: Manifest) -> None:
    for file, entry in sorted(manifest.files.items()):
        try:
            found = os.stat(os.path.join(path, file))  # noqa: PTH116, PTH118 (a part of every load)
        except (FileNotFoundError, NotADirectoryError):
            found = None
        if found is None or not stat.S_ISREG(found.st_mode):
            hint = repair_hint(path)
            raise MissingFileError(f"{path / file} is absent, the manifest lists it. {hint}")
        if found.st_size != entry.size:
            raise TruncatedFileError(
                f"{path / file} has {found.st_size} bytes, expected {entry.size}. "
                f"{repair_hint(path)}"
            )


def _read_small_files(path: Path, manifest: Manifest, *, is_checked: bool) -> dict[str, bytes]:
    """Reads every file that is no array's data, once for all who look at it."""
    shard_files = {file for plan in manifest.plan.values() for file in plan.files}
    contents = {}
    for name in sorted(manifest.files.keys() - shard_files):
        size = manifest.files[name].size
        if size > MAX_JSON_BYTES:
            problem = f"{name} is listed with {size} bytes, at most {MAX_JSON_BYTES} are allowed"
            raise _disagrees(path, manifest, problem)
        with open(os.path.join(path, name), "rb") as file:  # noqa: PTH118, PTH123 (a part of every load)
            contents[name] = file.read(size + 1)
        if is_checked and hashlib.sha256(contents[name]).hexdigest() != manifest.files[name].sha256:
            raise file_changed(path, name)
    return contents


def _check_metadata(path: Path, manifest: Manifest, small_files: Mapping[str, bytes]) -> None:
    """Checks that Zarr's own metadata says what the manifest says of arrays and identity."""
    for plan in manifest.plan.values():
        file = plan.metadata_file
        try:
            found = json.loads(small_files[file])
        except (ValueError, RecursionError) as error:
            raise ManifestError(
                f"{path / file} is not valid JSON: {error}. {repair_hint(path)}"
            ) from error
        for key, expected in plan.metadata.items():
            got = found.get(key) if isinstance(found, dict) else None
            if got != expected:
                problem = f"{path / file} has {key} {got}, expected {expected}"
                raise _disagrees(path, manifest, problem)
    attributes = root_attributes(path)
    for key, expected in (("id", manifest.id), ("recipe_hash", manifest.recipe_hash)):
        got = attributes.get(key, expected)  # the first datasets had no `recipe_hash` there
        if got != expected:
            problem = f"{path / GROUP_FILES[0]} says {key} {got!r}, the manifest says {expected!r}"
            raise _disagrees(path, manifest, problem)


def check_spec(path: Path, manifest: Manifest, recipe: Origin, *, widths: bool) -> None:
    """Checks that the spec in the recipe can be that of these arrays."""
    shapes = {name: entry.shape for name, entry in manifest.arrays.items()}
    try:
        problems = shape_contradictions(recipe, shapes, widths=widths)
    except (SpecError, SpawnError) as error:
        problems = (f"its spec is of no task: {error}",)
    images = [name for name in ("observations", "states") if manifest.arrays[name].dtype == "uint8"]
    if recipe.spec.world is not None and images:
        problems = (*problems, f"{', '.join(images)} are uint8, but a task observes no images")
    if problems:
        raise _disagrees(path, manifest, "; ".join(problems))


def shape_contradictions(
    origin: Origin, shapes: Mapping[str, tuple[int, ...]], *, widths: bool = True
) -> tuple[str, ...]:
    """A sentence for each array whose shape contradicts the dataset's spec.

    What is not a recipe may lack some arrays; `widths` is as of `task_row_shapes`.
    """
    problems = []
    for name, expected in row_shapes(origin, widths=widths).items():
        if name not in shapes:
            continue
        got = shapes[name][1:]
        is_absent = origin.recipe is None and name in MAY_BE_EMPTY and not math.prod(got)
        pairs = zip(got, expected, strict=False)
        is_fitting = len(got) == len(expected) and all(n in (None, size) for size, n in pairs)
        if not is_absent and not is_fitting:
            shown = ", ".join("any" if size is None else str(size) for size in expected)
            problems.append(f"{name} has rows of shape {list(got)}, expected [{shown}] by the spec")
    return tuple(problems)


def map_checked(path: Path, manifest: Manifest, name: str) -> NDArray[np.uint8]:
    """Maps the chunks of an array; empty for an array without elements.

    Raises:
        ChecksumError: they do not lie in order and without gaps, as a memory map assumes.
    """
    plan = manifest.plan[name]
    values, indices = map_array(path, plan)
    for index, (file, found) in enumerate(zip(plan.files, indices, strict=True)):
        if found != plan.shard.index_of(index):
            hint = repair_hint(path)
            raise ChecksumError(f"the shard index at the end of {path / file} was changed. {hint}")
    return values


def _check_chunks(path: Path, manifest: Manifest, raw: Mapping[str, NDArray[np.uint8]]) -> None:
    """Checks the xxh3_64 of every chunk, in as many threads as there are cores (ChecksumError)."""
    arrays = manifest.arrays.items()
    jobs = [(name, k, each) for name, entry in arrays for k, each in enumerate(entry.checksums)]
    n_threads = min(8, os.cpu_count() or 1)

    def changed(first: int) -> list[int]:
        """The changed chunks among every `n_threads`-th one."""
        found = []
        for k in range(first, len(jobs), n_threads):
            name, index, checksum = jobs[k]
            size = manifest.plan[name].shard.chunk_bytes
            chunk = raw[name][index * size : (index + 1) * size]
            if xxhash.xxh3_64_hexdigest(chunk.data) != checksum:
                found.append(k)
            release_pages(chunk)
        return found

    with ThreadPoolExecutor(n_threads) as pool:
        bad = [k for found in pool.map(changed, range(n_threads)) for k in found]
    if bad:
        name, index, _ = jobs[min(bad)]
        shard, files, *_ = manifest.plan[name]
        file = files[index // shard.shard_chunks]
        first, last = shard.rows_of(index)
        raise ChecksumError(
            f"{path / file} was changed after it was written: chunk {index} of {shard.n_chunks} "
            f"(rows {first} to {last} of {name!r}) does not have the checksum in the manifest. "
            f"{repair_hint(path)}"
        )


def read_origin(path: Path, manifest: Manifest, content: bytes) -> Origin:
    """Reads `recipe.json`."""
    # of the file, as written: what later versions add to a recipe does not change it
    written = hashlib.sha256(content).hexdigest()
    origin = _parsed(path, manifest, content)
    if (origin.id, written) != (manifest.id, manifest.recipe_hash):
        raise _disagrees(
            path, manifest, f"{path / RECIPE} is the recipe of another dataset, {origin.id}"
        )
    return origin


def _parsed(path: Path, manifest: Manifest, content: bytes) -> Origin:
    """The origin; a `ForeignOrigin` where another package defines a part of it."""
    file = path / RECIPE
    data: Any = None
    try:
        data = parse_json(content, str(file))
        return parse_origin(data, str(file))
    except SpecError as error:
        from swarmdata.specs.origins.foreign_origin import foreign_origin  # noqa: PLC0415

        shapes = {name: entry.shape for name, entry in manifest.arrays.items()}
        labels = tuple(map(str, root_attributes(path).get("policies", ())))
        found = foreign_origin(data, content.decode(), shapes, labels, manifest.provenance)
        if found is None:
            raise ManifestError(f"{file} cannot be read: {error}. {repair_hint(path)}") from error
        return found


def read_table(
    path: Path, manifest: Manifest, recipe: Origin, arrays: dict[str, NDArray[Any]]
) -> EpisodeTable:
    """Copies the episode table into memory and checks that it covers the arrays exactly."""
    names = [name for name in FIELDS if name.startswith("episodes/")]
    columns = {name.split("/")[1]: arrays[name].copy() for name in names}
    for column in columns.values():
        column.setflags(write=False)
    table = EpisodeTable(**columns)
    ends, is_solved = np.cumsum(table.lengths), table.end_reason == END_REASONS.index("success")
    problems = {
        "an episode has no steps": table.lengths < 1,
        "episodes do not follow each other without gaps": table.starts != ends - table.lengths,
        "episodes do not end where the arrays end": ends[-1:] != manifest.n_steps,
        "an unknown split code": table.split >= len(SPLITS),
        "an unknown end reason": table.end_reason >= len(END_REASONS),
        "an unknown policy": table.policy >= len(recipe.policies),
        "success and end reason differ": table.success != is_solved,
    }
    found = [problem for problem, wrong in problems.items() if wrong.any()]
    if found:
        raise _disagrees(path, manifest, f"the episode table is wrong: {'; '.join(found)}")
    return table


def _disagrees(path: Path, manifest: Manifest, problem: str) -> ManifestError:
    return ManifestError(
        f"the manifest of {path} disagrees with its contents: {problem}. {repair_hint(path)}"
    )
