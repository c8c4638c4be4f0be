"""The datasets in the cache that the package has no recipe of, and an index of them.

Opening thousands of datasets takes a minute. The index keeps what was found in each, with the
stamps of the files that it was read from. It is only ever a copy: an entry whose files have other
stamps, or had just been written, is made again; so is the index if it is damaged, of another
version, or lost. Processes that write it at once replace it whole, and the last one stands.
"""

import contextlib
import hashlib
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from tqdm import tqdm

from swarmdata.errors import DatasetError, SwarmdataError
from swarmdata.hub.catalog.catalog import DatasetInfo
from swarmdata.hub.catalog.identity import misnamed
from swarmdata.hub.catalog.request import cached_ids
from swarmdata.hub.remotes.outside_names import is_id
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.regular_files import read_regular
from swarmdata.store import open_store
from swarmdata.store.arrays.layout import DATA, MANIFEST, RECIPE
from swarmdata.store.cache import cache_folder

INDEX = "own-datasets.index"
"""File in the cache's folder: the SHA-256 of what follows in a line, then JSON."""

MAX_INDEX_BYTES = 1 << 26
"""An index above 64 MiB is not read; an entry has 300 bytes."""

SETTLING_TIME = 2.0  # s
"""Files that were written within this time may change again under the same stamp."""

Stamp = tuple[tuple[int, ...], ...]
Entries = Mapping[str, tuple[Stamp, DatasetInfo]]

_ENTRIES = TypeAdapter(dict[str, tuple[Stamp, DatasetInfo]])


def own_datasets(*, progress: bool = True) -> tuple[list[DatasetInfo], list[str]]:
    """Returns the datasets in the cache that the package has no recipe of, by id.

    Args:
        progress: whether to show a bar while those are opened that the index lacks.

    Returns:
        Them, and for each folder that is no usable dataset one sentence that says why.
    """
    place, index = cache_folder() / "datasets", cache_folder() / INDEX
    names = sorted(set(cached_ids(place)) - shipped_recipes().keys())
    known = _read(index)
    stamps = {name: _stamp(place / name) for name in names}
    found = {
        name: known[name] for name in names if name in known and known[name][0] == stamps[name]
    }
    problems = []
    unknown = [name for name in names if name not in found]
    for name in tqdm(
        unknown, "datasets", unit="dataset", leave=False, disable=None if progress else True
    ):
        try:
            found[name] = stamps[name], _info_of_folder(place / name)
        except SwarmdataError as error:
            problems.append(f"{place / name}: {error}")
    settled = {name: entry for name, entry in found.items() if _is_settled(entry[0])}
    if settled != known:
        _write(index, settled)
    return [found[name][1] for name in names if name in found], problems


def _info_of_folder(folder: Path) -> DatasetInfo:
    stored = open_store(folder, "none")
    manifest, recipe = stored.manifest, stored.recipe
    if (sentence := misnamed(folder, manifest)) is not None:
        raise DatasetError(f"{sentence}.")
    return DatasetInfo(
        id=manifest.id,
        task=recipe.spec.task,
        tier=recipe.tier,
        n_agents=recipe.spec.n_agents,
        n_steps=manifest.n_steps,
        n_episodes=manifest.n_episodes,
        n_bytes=sum(file.size for file in manifest.files.values()),
        score=None,
        digest=manifest.digest,
        is_cached=True,
    )


def _stamp(folder: Path) -> Stamp:
    """What changes with the files that are described; empty if one of them is absent.

    The time of the last change of an inode (ctime) cannot be set back, as that of its content can.
    """
    try:
        found = [(folder / name).stat() for name in ("", MANIFEST, RECIPE, DATA)]
    except OSError:
        return ()
    return tuple((s.st_ino, s.st_size, s.st_mtime_ns, s.st_ctime_ns) for s in found)


def _is_settled(stamp: Stamp) -> bool:
    """Whether whatever changes the files from now on changes their stamps."""
    settled = (time.time() - SETTLING_TIME) * 1e9
    return stamp != () and all(max(times) < settled for _, _, *times in stamp)


def _read(index: Path) -> Entries:
    """The entries of an index; none if it cannot be relied upon in every byte."""
    try:
        checksum, _, content = read_regular(index, MAX_INDEX_BYTES).partition(b"\n")
        if checksum != _checksum(content):
            return {}
        found = _ENTRIES.validate_json(content, strict=True)
    except (OSError, ValidationError):
        return {}
    return found if all(is_id(info.id) for _, info in found.values()) else {}


def _write(index: Path, entries: Entries) -> None:
    """Replaces the index; a cache that cannot be written to has none."""
    content = _ENTRIES.dump_json(dict(entries))
    with contextlib.suppress(OSError):
        write_file(index, _checksum(content) + b"\n" + content)


def _checksum(content: bytes) -> bytes:
    """Of an index that this version of the package has written, which decides what is usable."""
    return hashlib.sha256(version("swarmdata").encode() + b"\n" + content).hexdigest().encode()
