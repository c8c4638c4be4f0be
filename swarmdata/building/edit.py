"""Datasets of episodes of others, which keep split, seed and policy: filtered, combined, fewer."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

from swarmdata.building.combine import describe, write_edit
from swarmdata.building.subsample import N_RETURN_BINS, matched, sized
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.views import View
from swarmdata.errors import DatasetNotFoundError, SchemaError, check_type
from swarmdata.registry.recipes import check_own_id
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.frozen import differences
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.types import Int

LOADED = "swarmdata.load(...) gives one."  # what an id or a folder stands for

DEFAULT_TIER = "edited"
"""Tier of what was not given another: figures of an edit are in no tier's band."""


def filter_dataset(
    source: Dataset,
    out: Path | str | None = None,
    *,
    id: str,
    tier: str = DEFAULT_TIER,
    success: bool | None = None,
    min_return: float | None = None,
    max_return: float | None = None,
    policy: str | None = None,
    split: str | None = None,
    seeds: Collection[int] | None = None,
    episodes: Collection[int] | None = None,
) -> Dataset:
    """Makes a dataset of the episodes that meet every condition given.

    Args:
        source: a dataset or a view of it, such as `dataset.split("train")`.
        out: folder of the new dataset; None: in the cache. Where the same edit is there already, it
            is kept.
        id: of the new dataset, such as `coop_nav-solved-v0`.
        tier: of the new dataset.
        success: whether the task was solved.
        min_return: least team return, included.
        max_return: greatest team return, included.
        policy: label of a policy of the source.
        split: `train`, `validation` or `test`.
        seeds: of the episodes; all of them must be there.
        episodes: numbers in the source, as `source[number]` takes them, or a mask of them.

    Raises:
        UnknownNameError: no such policy or split.
        SchemaError: an episode that was asked for is not there.
        BuildError: no episode is left, or none to train on; or `out` holds something else.
    """
    conditions = {"success": success, "min_return": min_return, "max_return": max_return,
                  "policy": policy, "split": split}  # fmt: skip
    asked = {name: value for name, value in conditions.items() if value is not None}
    check_type("the source", source, Dataset, "a Dataset", LOADED)
    view = source.filter(**asked)  # type: ignore[arg-type]
    if seeds is not None:
        _check_list("seeds", seeds, "a list of seeds")
        wanted = _all_there(source.episodes.seeds, seeds, f"seeds of {source.id}")
        view = replace(view, selection=view.selection[np.isin(view.episodes.seeds, wanted)])
        asked["seeds"] = f"{len(wanted)} listed"
    if episodes is not None:
        numbers = _numbers(episodes, source)
        chosen = source.selection[numbers]
        view = replace(view, selection=view.selection[np.isin(view.selection, chosen)])
        asked["episodes"] = f"{len(numbers)} listed"
    return _edit([view], out, id, tier, _words("filter", asked))


def combine_datasets(
    sources: Sequence[Dataset],
    out: Path | str | None = None,
    *,
    id: str,
    tier: str = DEFAULT_TIER,
) -> Dataset:
    """Makes a dataset of the episodes of several, one after the other; of a view, just the view's.

    Policies that are the same but for their shares become one; where only the label is the same,
    the later one is called `<id of its dataset>/<label>`. Imported logs and files have no seeds but
    the numbers of their episodes; if such numbers clash, episodes get new seeds.

    Args:
        sources: datasets or views of the same spec, without a common episode.
        out: folder of the new dataset; None: in the cache. Where the same edit is there already, it
            is kept.
        id: of the new dataset.
        tier: of the new dataset.

    Raises:
        SpecError: the specs differ; the first difference is named.
        SchemaError: two episodes have the same seed, or arrays do not fit together.
        BuildError: there is no episode to train on; or `out` holds something else.
    """
    check_type("sources", sources, (list, tuple), "a list of datasets")
    if not sources:
        raise SchemaError("combine got no datasets, expected at least 1")
    for each in sources:
        check_type("a source", each, Dataset, "a Dataset", LOADED)
    return _edit(list(sources), out, id, tier, "combine()")


def subsample_dataset(
    source: Dataset,
    out: Path | str | None = None,
    *,
    id: str,
    tier: str = DEFAULT_TIER,
    n_steps: int | None = None,
    min_return: float | None = None,
    max_return: float | None = None,
    like: Dataset | None = None,
    bins: int | None = None,
    seed: int = 0,
) -> Dataset:
    """Makes a smaller dataset: of a size, of a range of returns, or with returns like another's.

    Args:
        source: a dataset or a view of it.
        out: folder of the new dataset; None: in the cache. Where the same edit is there already, it
            is kept.
        id: of the new dataset.
        tier: of the new dataset.
        n_steps: least joint steps; whole episodes are taken, at random, so that splits and policies
            keep about their shares (`subsample.sized`); of few episodes, a split may have none.
            With `like`, returns keep their shares.
        min_return: least team return, included.
        max_return: greatest team return, included.
        like: a dataset or view whose distribution of returns is matched (`subsampling.matched`).
        bins: of returns, only for `like`; None: 20.
        seed: of the choice, 0 to 2**64 - 1.

    Raises:
        SchemaError: nothing was asked for, more steps than there are, or an argument has a wrong
            type or range.
        BuildError: no episode is left, or none to train on, or returns cannot be matched; or `out`
            holds something else.
    """
    check_type("the source", source, Dataset, "a Dataset", LOADED)
    check_type("like", like, (View, NoneType), "a Dataset or None", LOADED)
    for name, given in {"n_steps": n_steps, "bins": bins}.items():
        if given is not None:
            _check_number(name, given)
    _check_number("seed", seed)
    if like is None and bins is not None:
        raise SchemaError(f"bins is {bins}, which are only for `like`: give both or none")
    view = source.filter(min_return=min_return, max_return=max_return)
    asked: dict[str, Any] = {"n_steps": n_steps, "min_return": min_return, "max_return": max_return}
    if like is not None:
        bins = N_RETURN_BINS if bins is None else bins
        chosen = matched(view.episodes, like.episodes.team_return, n_steps, bins, seed)
        which = f"{like.id} ({len(like)} episodes, digest {like.digest[:12]})"
        asked |= {"like": which, "bins": bins, "seed": seed}
    elif n_steps is not None:
        chosen = sized(view.episodes, n_steps, seed)
        asked["seed"] = seed
    elif min_return is None and max_return is None:
        raise SchemaError(
            "subsample was asked for nothing: give n_steps, a range of returns, or like"
        )
    else:
        chosen = np.arange(len(view))
    view = replace(view, selection=view.selection[chosen])
    return _edit([view], out, id, tier, _words("subsample", asked))


def rebuild_edit(edit: Edit, parents: Sequence[Dataset], out: Path | str) -> Dataset:
    """Makes an edited dataset again from its parents, in any order; the digest is the same.

    Where `out` has it already, it is kept.

    Raises:
        DatasetNotFoundError: a parent is missing.
        SchemaError: a parent does not have an episode, or the edit does not fit its parents.
        BuildError: `out` holds something else.
    """
    known = {parent.digest: parent for parent in parents}
    views = []
    for wanted in edit.parents:
        parent = known.get(wanted.digest)
        if parent is None:
            raise DatasetNotFoundError(
                f"{edit.id} is made from {wanted.id} with digest {wanted.digest[:12]}, got "
                f"{[f'{each.id} ({each.digest[:12]})' for each in parents]}"
            )
        chosen = np.array(wanted.episodes, dtype=np.int64)
        _all_there(np.arange(len(parent.stored.table)), wanted.episodes, f"episodes of {parent.id}")
        views.append(replace(parent, selection=chosen))
    again = describe(views, edit.id, edit.tier, edit.operation)
    if again != edit:
        path, here, there = next(differences(again, edit))
        raise SchemaError(f"{edit.id} does not fit its parents: {path} is {there!r}, not {here!r}")
    return write_edit(edit, views, Path(out))


def _words(operation: str, asked: Mapping[str, Any]) -> str:
    given = ", ".join(f"{name}={value}" for name, value in asked.items() if value is not None)
    return f"{operation}({given})"


def _check_number(name: str, given: Any) -> None:
    """Refuses what is no whole number from 0 to 2**64 - 1."""
    check_type(name, given, (int, np.integer), "a whole number")
    if not 0 <= given < 1 << 64:
        raise SchemaError(f"{name} is {given}, expected 0 to 2**64 - 1")


def _check_list(name: str, given: Any, expected: str) -> None:
    """Refuses what is no collection of whole numbers or truth values."""
    kinds = (int, np.integer, np.bool_)
    if not isinstance(given, Collection) or not all(isinstance(each, kinds) for each in given):
        raise SchemaError(f"{name} are {given!r:.100}, expected {expected}")


def _numbers(episodes: Collection[int], source: Dataset) -> Int:
    """The numbers of episodes of a source, given them or a mask [n]."""
    expected = f"numbers or a mask of {len(source)} episodes"
    _check_list("episodes", episodes, expected)
    found = np.array(list(episodes), dtype=None if len(episodes) else np.int64)
    if found.dtype == np.bool_ and len(found) == len(source):
        return np.flatnonzero(found)
    if found.dtype.kind not in "iu":
        raise SchemaError(f"episodes are {episodes!r:.100}, expected {expected}")
    return _all_there(np.arange(len(source)), found.tolist(), f"episodes of {source.id}")


def _all_there(there: Any, wanted: Collection[int], what: str) -> Any:
    """The wanted values, in the dtype of those that are there."""
    missing = sorted({int(each) for each in wanted} - set(there.tolist()))
    if missing:
        raise SchemaError(f"{what} {missing[:3]} are not there ({len(missing)} of {len(wanted)})")
    return np.array(list(wanted), dtype=there.dtype)


def _edit(
    views: list[Dataset], out: Path | str | None, name: str, tier: str, operation: str
) -> Dataset:
    check_type("out", out, (str, Path, NoneType), "a folder, or None for the cache")
    if out is None:  # where `load` finds it by its id
        check_own_id(name)
    folder = cache_folder() / "datasets" / name if out is None else Path(out)
    views = [replace(view, selection=np.unique(view.selection)) for view in views]
    return write_edit(describe(views, name, tier, operation), views, folder)
