"""Refuses results that are stale or cannot be compared, with one error that has all reasons."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import cache
from typing import TypeVar

from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.result_files import Result
from swarmdata.learn.training.run_files import CONFIG, run_hash
from swarmdata.registry.published import published
from swarmdata.specs.model_choice import describe, is_same_world
from swarmdata.specs.origins import Spec

Key = TypeVar("Key", bound=Hashable)

MAX_NAMED_FILES = 3  # files of each group that a message names; more are counted


def check_results(results: Sequence[Result]) -> None:
    """Checks that the results are current and can be compared."""
    problems = [*_stale_runs(results), *_stale_datasets(results), *_mixed(results)]
    if problems:
        reasons = "\n".join(f"- {problem}" for problem in problems)
        raise ResultsError(f"these results cannot be compared in one table:\n{reasons}")


def _stale_runs(results: Sequence[Result]) -> Iterator[str]:
    hash_of = cache(run_hash)  # one checkpoint holds several seeds
    stale = []
    for result in results:
        provenance, folder = result.provenance, result.run_folder
        if folder is None or provenance.content is None or not (folder / CONFIG).exists():
            continue  # the run folder is not here, so nothing can be compared
        if provenance.algorithm is None or provenance.seed is None:
            continue
        seed = 0 if provenance.frames is None else provenance.seed
        if hash_of(folder, seed) != provenance.content:
            stale.append(result)
    if stale:
        runs = sorted({str(each.provenance.run) for each in stale})
        yield (
            f"{_names(stale)}: the runs have changed since they were evaluated: {', '.join(runs)}. "
            "Evaluate again."
        )


def _stale_datasets(results: Sequence[Result]) -> Iterator[str]:
    for dataset, group in _groups(results, lambda each: each.provenance.dataset).items():
        entry = published().get(str(dataset))
        other = [each for each in group if entry and each.provenance.digest != entry.digest]
        if entry and other:
            yield (
                f"{_names(other)}: trained on {dataset} with digest "
                f"{str(other[0].provenance.digest)[:12]}, but the published one has "
                f"{entry.digest[:12]}. Train on the published one, or give yours another id."
            )


def _mixed(results: Sequence[Result]) -> Iterator[str]:
    yield from _differing(results, "measured by version", lambda each: _version(each)[0])
    for task, group in _groups(results, lambda each: each.spec.task).items():
        code = "measured with its code at hash"
        yield from _differing(group, f"in {task}: {code}", lambda each: _version(each)[2])
    yield from _differing(
        [each for each in results if each.spec.world is not None], "measured on", _episodes
    )
    yield from _mixed_specs(results)
    for dataset, group in _groups(results, lambda each: each.provenance.dataset_key).items():
        if dataset is not None:
            others = [each for each in group if each.spec.world is None]
            yield from _differing(others, f"on {dataset}: measured on", _episodes)
            yield from _differing(
                group, f"on {dataset}: of digest", lambda each: str(each.provenance.digest)[:12]
            )
            yield from _differing(group, f"on {dataset}: measured in", _world)
    for (label, *_), group in _groups(results, _row).items():
        yield from _mixed_label(label, group)


def _version(result: Result) -> tuple[str, str, str]:
    """The version of this package, and after + the hash of the code of a user's task."""
    return result.provenance.code_version.partition("+")


def _row(result: Result) -> tuple[str, str | None]:
    """The key of a table's row: a label on all datasets, or in one spec if it used no data."""
    provenance = result.provenance
    return provenance.label, None if provenance.dataset else result.evaluation.spec_hash


def _mixed_label(label: str, group: Sequence[Result]) -> Iterator[str]:
    yield from _differing(group, f"{label}: trained by", lambda each: each.provenance.algorithm)
    yield from _differing(group, f"{label}: trained for", _budget)
    yield from _differing(group, f"{label}: trained with", lambda each: _settings(each, group))
    yield from _repeated_seeds(label, group)
    for who, same in _groups(
        group,
        lambda each: (
            each.provenance.dataset_key, each.evaluation.spec_hash, each.provenance.index,
        ),
    ).items():  # fmt: skip
        if len(same) > 1:
            yield (
                f"{_names(same)}: {len(same)} results of {label} number {who[2]}"
                f"{f' on {who[0]}' if who[0] else ''}. Leave out all but one, or give them "
                "different labels."
            )


def _repeated_seeds(label: str, group: Sequence[Result]) -> Iterator[str]:
    """Results that count as several trainings, and are of one."""
    trained = [each for each in group if each.provenance.seed is not None]
    alike = _groups(
        trained,
        lambda each: (
            each.evaluation.spec_hash, each.provenance.model_copy(update={"index": 0}).to_json(),
        ),
    )  # fmt: skip
    for same in alike.values():
        if len({each.provenance.index for each in same}) > 1:
            yield (
                f"{_names(same)}: {len(same)} results of {label} are of the training seed "
                f"{same[0].provenance.seed}. Leave out all but one."
            )


def _mixed_specs(results: Sequence[Result]) -> Iterator[str]:
    """Policies in one world need the same models, unless they learned from re-observed data."""
    groups = _groups(results, lambda each: each.evaluation.spec_hash)
    specs = {key: group[0].spec for key, group in groups.items()}
    for key, group in groups.items():
        if any(each.provenance.dataset for each in group):
            continue
        others = [k for k in groups if k != key and _are_of_one_world(specs[key], specs[k])]
        if others:
            yield (
                f"{_names(group)}: measured under other models than {_names(groups[others[0]])}: "
                f"{'; '.join(describe(w) for k in (key, others[0]) if (w := specs[k].world))}. "
                "Evaluate all under one pair."
            )


def _are_of_one_world(one: Spec, other: Spec) -> bool:
    return bool(one.world and other.world and is_same_world(one.world, other.world))


def _world(result: Result) -> str:
    spec = result.spec
    what = f" ({describe(spec.world)})" if spec.world else ""
    return f"{spec.task} {result.evaluation.spec_hash[:12]}{what}"


def _episodes(result: Result) -> str:
    seeds = result.evaluation.seeds
    return f"{len(seeds)} episodes from seed {seeds[0]}"


def _budget(result: Result) -> str:
    provenance = result.provenance
    lengths = {"updates": provenance.updates, "joint steps": provenance.frames}
    known = [f"{n:,} {unit}" for unit, n in lengths.items() if n is not None]
    return " and ".join(known) or "an unknown time"


def _settings(result: Result, group: Sequence[Result]) -> str:
    """The settings of a result that differ within its group."""
    configs = [each.provenance.config for each in group]
    names = sorted({name for config in configs for name in config})
    own = result.provenance.config
    different = [name for name in names if any(c.get(name) != own.get(name) for c in configs)]
    return ", ".join(f"{name} {own.get(name)!r}" for name in different) or "the same settings"


def _differing(
    results: Sequence[Result], what: str, of: Callable[[Result], str | None]
) -> Iterator[str]:
    """Yields one line if a property has several values, with the files of each."""
    groups = _groups(results, of)
    if len(groups) > 1:
        sides = "; ".join(f"{value} ({_names(group)})" for value, group in groups.items())
        yield f"{what} {sides}. Make them equal, or report them separately."


def _groups(results: Sequence[Result], of: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    groups: dict[Key, list[Result]] = {}
    for result in results:
        groups.setdefault(of(result), []).append(result)
    return groups


def _names(results: Sequence[Result]) -> str:
    names = [
        f"{each.provenance.label}-{each.provenance.index}" if each.path is None else str(each.path)
        for each in results
    ]
    more = f" and {len(names) - MAX_NAMED_FILES} more" if len(names) > MAX_NAMED_FILES else ""
    return ", ".join(names[:MAX_NAMED_FILES]) + more
