"""Describes an edited dataset by its parents and policies, and writes its folder."""

import hashlib
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.cards.side_files import finish
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, SpecError
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.runtime.atomic import remove_leftovers
from swarmdata.runtime.locking import locked
from swarmdata.specs.frozen import differences
from swarmdata.specs.origins import Origin, check_installed
from swarmdata.specs.origins.edit_origin import Edit, Parent
from swarmdata.specs.origins.log_origin import ImportedLogs
from swarmdata.specs.origins.recording_origin import NUMBERED_SEEDS
from swarmdata.specs.recipe import MOST_POLICIES, PolicySource, who_acts
from swarmdata.store import SPLITS
from swarmdata.store.arrays.layout import CARD, CHECKPOINTS
from swarmdata.store.assembly import write_dataset
from swarmdata.store.episode_selection import Piece, Selection
from swarmdata.types import Int, Seeds


def describe(views: Sequence[Dataset], name: str, tier: str, operation: str) -> Edit:
    """The origin of the dataset of all views' episodes; errors are those of `combine_datasets`."""
    _check_specs(views)
    _check_episodes(views)
    policies, _ = merge_policies(views)
    parents = tuple(
        Parent(id=view.id, digest=view.digest, episodes=tuple(view.selection.tolist()))
        for view in views
    )
    content = {
        "id": name,
        "tier": tier,
        "spec": views[0].recipe.spec.model_dump(mode="json"),
        "operation": operation,
        "policies": [p.model_dump() for p in policies],
        "parents": [p.model_dump() for p in parents],
    }
    return Edit.parse(content, f"edit {name}")


def _check_specs(views: Sequence[Dataset]) -> None:
    first = views[0]
    for view in views:
        check_installed(view.recipe, "an edit")
        for computed, what, method in (
            (view.reobservation, "is a reobservation, which is", "reobserve"),
            (view.reweighting, "has other rewards than were recorded, which are", "with_rewards"),
            (view.side_view, "is one side, which is", "side"),
        ):
            if computed is not None:
                raise SpecError(
                    f"{view!r} {what} in no file. Edit the whole dataset as it was recorded, then "
                    f"call `{method}` on the result."
                )
        if view.recipe.spec != first.recipe.spec:
            path, here, there = _difference(first, view)
            raise SpecError(
                f"{first.id} and {view.id} are of different specs: {path} is {here!r} and {there!r}"
            )


def _difference(one: Dataset, other: Dataset) -> tuple[str, Any, Any]:
    """The first difference of two specs; other tasks differ in everything, and first in name."""
    if one.spec.task != other.spec.task:
        return "task", one.spec.task, other.spec.task
    return next(differences(one.recipe.spec, other.recipe.spec))


def _check_episodes(views: Sequence[Dataset]) -> None:
    if not all(map(len, views)):
        empty = [view.id for view in views if not len(view)]
        returns = np.concatenate([view.stored.table.team_return for view in views if not len(view)])
        raise BuildError(
            f"no episode of {', '.join(empty)} meets the conditions; their team returns are "
            f"{returns.min():.6g} to {returns.max():.6g}. Widen the conditions."
        )
    seeds = np.concatenate(episode_seeds(views)).tolist()
    sources = [source for view in views for source in _sources(view)]
    if same := _repeated(seeds) or _repeated(sources):
        owners = [(view.id, number) for view in views for number in view.selection.tolist()]
        (one, k), (other, j) = owners[same[0][0]], owners[same[0][1]]
        raise SchemaError(
            f"episode {k} of {one} and episode {j} of {other} have the same seed or parent, "
            f"{len(same)} pairs in all: an episode may be in a dataset once, or it could be in "
            "train and test. Leave one of each out with `filter`. If they come from different logs "
            "or files, whose seeds only number the episodes, combine the imported datasets in one "
            "call, before any other edit."
        )
    if not any((view.episodes.split == SPLITS.index("train")).any() for view in views):
        raise BuildError(
            "none of the episodes is in the train split, which normalization statistics come from. "
            "To look at held-out episodes, use a view: dataset.split('test')."
        )


def _sources(view: Dataset) -> list[tuple[str, int]]:
    """The dataset that each episode was taken from, by its digest, and the number of it there."""
    origin, numbers = view.recipe, view.selection.tolist()
    if not isinstance(origin, Edit):
        return [(view.digest, number) for number in numbers]
    taken = [(parent.digest, number) for parent in origin.parents for number in parent.episodes]
    return [taken[number] for number in numbers]


def _repeated(keys: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Pairs of places with the same key: its first, and another."""
    first: dict[Hashable, int] = {}
    places = ((first.setdefault(key, k), k) for k, key in enumerate(keys))
    return [pair for pair in places if pair[0] != pair[1]]


def episode_seeds(views: Sequence[Dataset]) -> list[Seeds]:
    """The seeds that the episodes of each view get in the dataset of them all, [n] each.

    They stay what they are, unless all views were imported from different files, whose seeds only
    number the episodes, and have numbers in common: then hashes of the files and the number. The
    same if this gives an episode a seed of another view, which then contains it already.
    """
    seeds = [view.episodes.seeds for view in views]
    files = [_numbered_files(view.recipe) for view in views]
    pairs = list(zip(files, seeds, strict=True))
    hashes = [_hashes(names, numbers) if names else numbers for names, numbers in pairs]
    apart = all(files) and len(frozenset[str]().union(*files)) == sum(map(len, files))
    repeats = [_repeated(np.concatenate(each).tolist()) for each in (seeds, hashes)]
    return hashes if (apart and repeats[0]) or repeats[1] else seeds


def _numbered_files(origin: Origin) -> frozenset[str]:
    """SHA-256 of the files that were imported, if seeds number their episodes; else none."""
    if not NUMBERED_SEEDS.items() <= (origin.metadata or {}).items():
        return frozenset()
    if isinstance(origin, ImportedLogs):
        return frozenset(file.sha256 for file in origin.files)
    return frozenset() if origin.source_sha256 is None else frozenset([origin.source_sha256])


def _hashes(files: frozenset[str], numbers: Seeds) -> Seeds:
    digest = hashlib.sha256("".join(sorted(files)).encode()).digest()
    return derive(int.from_bytes(digest[:8]), numbers) % np.uint64(EVALUATION_BASE)


def merge_policies(
    views: Sequence[Dataset],
) -> tuple[tuple[PolicySource, ...], list[dict[int, int]]]:
    """The policies of the views' episodes, and for each view the new index of each old one."""
    merged: dict[str, PolicySource] = {}
    maps: list[dict[int, int]] = []
    for view in views:
        maps.append({})
        for index in np.unique(view.episodes.policy).tolist():
            source = view.recipe.policies[index]
            label = _label(source, view.id, merged)
            merged.setdefault(label, source.model_copy(update={"label": label}))
            maps[-1][index] = list(merged).index(label)
    if len(merged) > MOST_POLICIES:
        raise SchemaError(f"there are {len(merged)} policies, expected at most {MOST_POLICIES}")
    return tuple(merged.values()), maps


def _label(source: PolicySource, dataset: str, taken: Mapping[str, PolicySource]) -> str:
    """The source's own label, unless another policy has it."""
    long = f"{dataset}/{source.label}"
    for label in (source.label, long, *(f"{long}-{k}" for k in range(2, MOST_POLICIES + 2))):
        there = taken.get(label)
        changes = {"label": label, "share": 1.0}  # shares mean nothing here
        if there is None or there.model_copy(update=changes) == source.model_copy(update=changes):
            return label
    raise SchemaError(f"there are too many policies with the label {source.label!r}")


def write_edit(edit: Edit, views: Sequence[Dataset], out: Path) -> Dataset:
    """Writes the dataset of an edit, with a card if all parents have one; one process at a time."""
    _, maps = merge_policies(views)
    pieces = [
        Piece(view.stored, _increasing(view), map_, seeds)
        for view, map_, seeds in zip(views, maps, episode_seeds(views), strict=True)
    ]
    with locked(out):
        remove_leftovers(out.parent, out.name)
        write_dataset(out, edit, Selection(pieces), _own_networks(edit, views))
        if all((view.path / CARD).exists() for view in views):
            finish(out)
    return Dataset.open(out, references=views[0].references)


def _own_networks(edit: Edit, views: Sequence[Dataset]) -> dict[str, bytes]:
    """The networks that the views keep and the edit's policies name, by file name."""
    named = {f"{CHECKPOINTS}/{policy.checkpoint}" for policy in who_acts(edit.policies)}
    return {
        Path(file).name: (view.path / file).read_bytes()
        for view in views
        for file in named & set(view.stored.manifest.files)
    }


def _increasing(view: Dataset) -> Int:
    if (np.diff(view.selection) <= 0).any():
        raise SchemaError(f"episodes of {view.id} are not in increasing order")
    return view.selection
