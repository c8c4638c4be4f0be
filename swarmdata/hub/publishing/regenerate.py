"""Makes published datasets again, and says in what they differ from what was published."""

import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from swarmdata.building.build import build
from swarmdata.errors import DatasetNotFoundError, SchemaError, UnknownNameError
from swarmdata.hub.catalog.listing import dataset_folder
from swarmdata.registry.published import Published, changed_versions, published
from swarmdata.registry.recipes import find_recipe, is_dataset, shipped_recipes
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.locking import locked
from swarmdata.specs.recipe import Recipe
from swarmdata.store import open_store, write_file
from swarmdata.store.manifest import is_finished
from swarmdata.store.publication import publication
from swarmdata.store.scratch import remove_scratch, scratch_folder

MINI_MARK = "-mini-v"  # in the ids of minis


class Difference(NamedTuple):
    """One published value that was not found again: a row of the report."""

    dataset: str  # id
    what: str  # path of the value, such as `policies.expert-0.success`
    published: str
    found: str


@dataclass(frozen=True)
class Check:
    """What came out of making one published dataset again."""

    dataset: str  # id
    differences: tuple[Difference, ...]
    versions: tuple[str, ...]  # what differs from the versions that it was published with


def published_ids(names: Sequence[str] = (), *, minis: bool = False) -> tuple[str, ...]:
    """Returns the published ids that names mean, in order; without names all.

    Names may lack the version. `minis` leaves out what is no mini.
    """
    known = published()
    chosen = [find_recipe(name).id if is_dataset(name) else name for name in names] or sorted(known)
    for name in chosen:
        if name not in known:
            raise UnknownNameError("published dataset", name, known)
    return tuple(name for name in dict.fromkeys(chosen) if MINI_MARK in name or not minis)


def check(
    ids: Sequence[str],
    failures: Failures,
    *,
    cached: bool = False,
    workers: int | None = None,
    engine: str | Executor = LOCAL,
    progress: bool = True,
) -> Iterator[Check]:
    """Makes published datasets again, as `make_again` does, and compares them."""
    entries, recipes = published(), shipped_recipes()
    for key in tqdm(ids, "datasets", unit="dataset", disable=None if progress else True):
        entry, recipe = entries[key], recipes.get(key)
        if recipe is None:
            gone = Difference(key, "recipe", entry.recipe_hash[:12], "none")
            yield Check(key, (gone,), ())
            continue
        with failures.item(key):
            found = make_again(
                recipe, cached=cached, workers=workers, engine=engine, progress=progress
            )
            versions = changed_versions(entry.made_with, found.made_with)
            yield Check(key, differences(key, entry, found), versions)


def make_again(
    recipe: Recipe,
    *,
    cached: bool = False,
    workers: int | None = None,
    engine: str | Executor = LOCAL,
    progress: bool = True,
) -> Published:
    """Builds a dataset from nothing, measures it and removes it; a copy in the cache is not used.

    With `cached`, the copy in the cache is measured instead, after reading every byte, if there is
    one. `workers` and `engine` are as `build` takes them; all processes see the cache.
    """
    kept = dataset_folder(recipe.id)
    if cached and is_finished(kept, recipe):
        return publication(open_store(kept, "full"))
    scratch = scratch_folder(cache_folder() / "checks" / recipe.id, "check")
    with locked(scratch, progress):
        remove_scratch(scratch)  # parts of a killed check may have been made by older code
        try:
            build(recipe, scratch / recipe.id, workers=workers, engine=engine, progress=progress)
            return publication(open_store(scratch / recipe.id, "full"))
        finally:
            remove_scratch(scratch)


def differences(dataset: str, entry: Published, found: Published) -> tuple[Difference, ...]:
    """What differs but for versions and platform, which alone are no difference."""
    mine, theirs = (
        dict(_values("", asdict(replace(each, made_with={})))) for each in (found, entry)
    )
    return tuple(
        Difference(dataset, what, _shown(theirs.get(what)), _shown(mine.get(what)))
        for what in sorted(mine.keys() | theirs.keys())
        if mine.get(what) != theirs.get(what)
    )


def _values(path: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _values(f"{path}{key}.", value)
        else:
            yield f"{path}{key}", value


def _shown(value: Any) -> str:
    """Digests are cut to 12 digits; numbers are shown exactly."""
    return "none" if value is None else value[:12] if isinstance(value, str) else repr(value)


def report(checks: Sequence[Check]) -> str:
    """Returns one table of all differences, then what else there is to say, as text."""
    found = [each for check in checks for each in check.differences]
    rows = [Difference._fields, *found] if found else []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    changed = sorted({version for check in checks for version in check.versions})
    if changed:
        lines.append(f"made here with {', '.join(changed)}")
    wrong = sum(bool(check.differences) for check in checks)
    lines.append(f"{len(checks)} datasets checked, {wrong or 'none'} with differences")
    return "\n".join(lines) + "\n"


def put_entries(path: Path, entries: Mapping[str, Any]) -> None:
    """Replaces or adds keys of a JSON file, sorted, in one rename; processes wait in turn."""
    if not path.parent.is_dir():
        raise DatasetNotFoundError(
            f"there is no folder {path.parent} for {path.name}. Run this in the repository, or say "
            "where the file is with --out."
        )
    with locked(path, shown=False):
        content = {**_entries(path), **entries}
        text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
        write_file(path, f"{text}\n".encode())


def _entries(path: Path) -> dict[str, Any]:
    """The entries of a JSON file, none if it does not exist."""
    if not path.exists():
        return {}
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise SchemaError(f"{path} is not JSON: {error}. Restore it.") from error
    if not isinstance(there, dict):
        raise SchemaError(f"{path} holds a {type(there).__name__}, expected an object.")
    return there
