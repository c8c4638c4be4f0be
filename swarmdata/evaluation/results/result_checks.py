"""What makes results stale or unfit to stand in one table; every reason is found before one error.

- stale: the run that a file names is there and is not the one that was measured, or the dataset's
  digest is not the one that is published under its id;
- mixed: other code, episodes, specs or contents of one dataset; other settings or lengths of
  training under one label; one policy twice.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TypeVar

from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.result_files import Result
from swarmdata.learn.training.run_files import CONFIG, run_hash
from swarmdata.registry.published import published
from swarmdata.specs.model_choice import describe, is_same_world
from swarmdata.specs.origins import Spec

Key = TypeVar("Key", bound=Hashable)

_SHOWN = 3
"""Files that a message names of each side."""


def check_results(results: Sequence[Result]) -> None:
    """Raises unless the results are current and belong together.

    Raises:
        ResultsError: every reason why not, with the files.
    """
    problems = [*_stale_runs(results), *_stale_datasets(results), *_mixed(results)]
    if problems:
        reasons = "\n".join(f"- {problem}" for problem in problems)
        raise ResultsError(f"these results cannot stand in one table:\n{reasons}")


def _stale_runs(results: Sequence[Result]) -> Iterator[str]:
    hash_of = cache(run_hash)  # one checkpoint holds several seeds
    stale = []
    for result in results:
        provenance, folder = result.provenance, result.run_folder
        if folder is None or provenance.content is None or not (folder / CONFIG).exists():
            continue  # the run is elsewhere: the file is all there is
        if provenance.algorithm is None or provenance.seed is None:
            continue
        seed = 0 if provenance.frames is None else provenance.seed
        if hash_of(folder, seed) != provenance.content:
            stale.append(result)
    if stale:
        runs = sorted({str(each.provenance.run) for each in stale})
        yield (
            f"{_names(stale)}: trained on, or again, since they were measured: {', '.join(runs)}. "
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
    yield from _differing(results, "measured by version", lambda each: each.provenance.code_version)
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


def _row(result: Result) -> tuple[str, str | None]:
    """What one line of a table is of: a label on all datasets, or in one spec without data."""
    provenance = result.provenance
    return provenance.label, None if provenance.dataset else result.evaluation.spec_hash


def _mixed_label(label: str, group: Sequence[Result]) -> Iterator[str]:
    yield from _differing(group, f"{label}: trained by", lambda each: each.provenance.algorithm)
    yield from _differing(group, f"{label}: trained for", _budget)
    yield from _differing(group, f"{label}: trained with", lambda each: _settings(each, group))
    for who, same in _groups(
        group,
        lambda each: (
            each.provenance.dataset_key, each.evaluation.spec_hash, each.provenance.index,
        ),
    ).items():  # fmt: skip
        if len(same) > 1:
            yield (
                f"{_names(same)}: {len(same)} results of {label} number {who[2]}"
                f"{f' on {who[0]}' if who[0] else ''}. Leave out all but one, or give them labels "
                "of their own."
            )


def _mixed_specs(results: Sequence[Result]) -> Iterator[str]:
    """One world is compared under one pair of models, unless datasets were observed again."""
    groups = _groups(results, lambda each: each.evaluation.spec_hash)
    specs = {key: group[0].spec for key, group in groups.items()}
    for key, group in groups.items():
        if any(each.provenance.dataset for each in group):
            continue
        others = [k for k in groups if k != key and _is_same_world(specs[key], specs[k])]
        if others:
            yield (
                f"{_names(group)}: measured under other models than {_names(groups[others[0]])}: "
                f"{_models(specs[key])}; {_models(specs[others[0]])}. Evaluate all under one pair."
            )


def _is_same_world(one: Spec, other: Spec) -> bool:
    if one.world is None or other.world is None:
        return False
    return is_same_world(one.world, other.world)


def _models(spec: Spec) -> str:
    return describe(spec.world) if spec.world else "an environment of another library"


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
    """The settings of one of a label's results in which the label's results differ."""
    configs = [each.provenance.config for each in group]
    names = sorted({name for config in configs for name in config})
    own = result.provenance.config
    different = [name for name in names if any(c.get(name) != own.get(name) for c in configs)]
    return ", ".join(f"{name} {own.get(name)!r}" for name in different) or "the same settings"


def _differing(
    results: Sequence[Result], what: str, of: Callable[[Result], str | None]
) -> Iterator[str]:
    """One line if a property has several values, with the files of each."""
    groups = _groups(results, of)
    if len(groups) > 1:
        sides = "; ".join(f"{value} ({_names(group)})" for value, group in groups.items())
        yield f"{what} {sides}. Make them alike, or report them apart."


def _groups(results: Sequence[Result], of: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    groups: dict[Key, list[Result]] = {}
    for result in results:
        groups.setdefault(of(result), []).append(result)
    return groups


def _names(results: Sequence[Result]) -> str:
    """Files of results, or who they are of; a few of them."""
    names = [_name(result) for result in results]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _name(result: Result) -> str:
    path: Path | None = result.path
    return str(path) if path is not None else f"{result.provenance.label}-{result.provenance.index}"
