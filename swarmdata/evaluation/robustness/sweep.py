"""Evaluates trained policies under worse communication and sensing, with everything else fixed.

results/trained/            results with everything as in training, files of `result_files.save`
results/PART-NAME-VALUE/    the same at one value of an axis
sweep.csv, sweep.md         every estimate; a table for each axis
PART-NAME.png               a figure for each axis

A sweep that was stopped goes on where it was: results that are there of the same policies, seeds
and code are read, not measured again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from swarmdata.behavior_policies.learned import Learned
from swarmdata.errors import SpecError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.robustness.sweep_axes import Axis, Course, course_of
from swarmdata.evaluation.robustness.sweep_estimates import estimates_of
from swarmdata.evaluation.robustness.sweep_plots import plot_degradation
from swarmdata.evaluation.robustness.sweep_tables import Degradation, Line, Point, to_csv
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.locking import updating
from swarmdata.specs.model_choice import is_same_world
from swarmdata.specs.task_spec import TaskSpec

SUMMARY = "sweep.csv"

TRAINED = "trained"
"""Folder of results with everything as in training."""

Results = dict[str, list[Result]]
"""Folder's name -> one result per policy."""


@dataclass(frozen=True, eq=False)
class _Team:
    """What is swept, what it is called, and where each axis leads it."""

    label: str
    target: Target
    courses: tuple[Course, ...]  # one per axis


class _Place(NamedTuple):
    """One spec to evaluate a team in."""

    value: float | None  # of the axis; None: as trained, which is no number
    folder: str  # of its results
    spec: TaskSpec


def sweep(
    names: Sequence[str],
    axes: Sequence[Axis],
    out: Path,
    *,
    n_episodes: int = 200,
    task: str = "coop_nav",
    progress: bool = True,
) -> list[Degradation]:
    """Evaluates teams along axes, one parameter at a time, and writes tables and figures.

    Args:
        names: what `targets.find_target` finds: runs online and offline, tiers, datasets of
            trained policies.
        axes: parameters and their values.
        out: folder; a stopped sweep of the same teams goes on in it.
        n_episodes: first so many reserved seeds, the same at every point.
        task: of tiers: a preset's name, or a spec's file.
        progress: whether to show a bar.

    Raises:
        UnknownNameError: no such team or parameter.
        SpecError: nothing to sweep, teams of different worlds, a value out of its range, or
            communication of a team that does not talk.
        SchemaError: a team cannot read what a value gives.
        ResultsError: `out` has results of another run with the name and dataset of one of these.
        MissingExtraError: matplotlib, or torch for a run, is not installed.
    """
    require_extra("matplotlib", "plots", "drawing the figures of a sweep")
    _check_axes(axes)
    teams = _teams(names, axes, task)
    with updating(out / SUMMARY, progress):
        results = _measured(teams, axes, out / "results", n_episodes, progress=progress)
        found = [_degradation(k, axes, teams, results, n_episodes) for k in range(len(axes))]
        _write(found, out)
    return found


def _measured(
    teams: Sequence[_Team], axes: Sequence[Axis], folder: Path, n_episodes: int, *, progress: bool
) -> list[Results]:
    """Evaluates every team in every place, as far as the folder lacks it."""
    n_all = sum(len(team.target.policies) * len(_places(team, axes)) for team in teams)
    results: list[Results] = [{} for _ in teams]
    with tqdm(total=n_all, unit="evaluation", disable=None if progress else True) as bar:
        for team, found in zip(teams, results, strict=True):
            for name, spec in _places(team, axes).items():
                bar.set_description(f"{team.label} {name}", refresh=False)
                there = replace(team.target, spec=spec)
                found[name] = evaluate_target(there, n_episodes, folder / name, progress=False)
                bar.update(len(found[name]))
    return results


def _check_axes(axes: Sequence[Axis]) -> None:
    if not axes:
        raise SpecError(
            "there is nothing to sweep. Give at least one axis, such as --communication "
            "drop=0..0.8 or --observation noise=0..0.2."
        )
    swept = [axis.parameter for axis in axes]
    twice = [parameter for parameter in swept if swept.count(parameter) > 1]
    if twice:
        raise SpecError(f"{twice[0]} is swept twice. Put its values into one axis.")


def _teams(names: Sequence[str], axes: Sequence[Axis], task: str) -> list[_Team]:
    """Everything that is to be measured, checked before anything is."""
    targets = []
    for name in names:
        targets.append(find_target(name, task))
        _check_senses(targets[-1], name)
    teams = [
        _Team(label, target, tuple(course_of(axis, name, target.spec) for axis in axes))
        for name, label, target in zip(names, _labels(targets), targets, strict=True)
    ]
    first = teams[0]
    for other in teams[1:]:
        if not is_same_world(first.target.spec, other.target.spec):
            raise SpecError(
                f"{first.label} and {other.label} were trained in different worlds "
                f"({first.target.spec.task} and {other.target.spec.task}, or other rules, teams or "
                "arenas). Sweep them apart, each with its own --out."
            )
    return teams


def _labels(targets: Sequence[Target]) -> list[str]:
    """What the teams are called: with their datasets, where one label is on several.

    Raises:
        SpecError: two teams have one label and one dataset, and so the same files.
    """
    names = [target.label for target in targets]
    keys = [target.provenances[0].dataset_key for target in targets]
    both = list(zip(names, keys, strict=True))
    twice = next((pair for pair in both if both.count(pair) > 1), None)
    if twice is not None:
        raise SpecError(
            f"two of the teams are called {twice[0]!r}{f' on {twice[1]}' if twice[1] else ''}, so "
            "their results could not be told apart. Name each once, or rename a run's folder."
        )
    return [
        f"{name} on {key}" if key is not None and names.count(name) > 1 else name
        for name, key in both
    ]


def _check_senses(target: Target, name: str) -> None:
    is_trained = any(isinstance(policy, Learned) for policy in target.policies)
    if target.provenances[0].run is None and not is_trained:
        raise SpecError(
            f"{name} does not act on what robots see and hear, so worse models cannot hurt it. "
            "Sweep trained policies: a run's folder, or a tier such as expert."
        )


def _places(team: _Team, axes: Sequence[Axis]) -> dict[str, TaskSpec]:
    """Folder's name -> spec: as trained, then along each axis what is not as trained."""
    places = {TRAINED: team.target.spec}
    for axis, course in zip(axes, team.courses, strict=True):
        places |= {place.folder: place.spec for place in _along(axis, course, team.target.spec)}
    return places


def _degradation(
    k: int,
    axes: Sequence[Axis],
    teams: Sequence[_Team],
    results: Sequence[Results],
    n_episodes: int,
) -> Degradation:
    """What was measured along axis k."""
    axis = axes[k]
    lines: list[Line] = []
    columns: tuple[Column, ...] = ()
    for team, found in zip(teams, results, strict=True):
        points = []
        trained = team.target.spec
        for value, folder, spec in _along(axis, team.courses[k], trained):
            columns, estimates = estimates_of(found[folder], found[TRAINED], spec, trained)
            points.append(Point(value, folder == TRAINED, estimates))
        lines.append(Line(team.label, len(team.target.policies), tuple(points)))
    return Degradation(axis.part, axis.name, columns, tuple(lines), n_episodes, axis.falls)


def _along(axis: Axis, course: Course, trained: TaskSpec) -> list[_Place]:
    """The places of an axis in its order, as trained among them, or first if it is no number."""
    places = [
        _Place(value, f"{axis.part}-{axis.name}-{value}", spec)
        for value, spec in zip(axis.values, course.specs, strict=True)
        if value != course.trained and spec != trained
    ]
    places.append(_Place(course.trained, TRAINED, trained))
    sign = -1.0 if axis.falls else 1.0
    return sorted(places, key=lambda p: -np.inf if p.value is None else sign * p.value)


def _write(found: Sequence[Degradation], out: Path) -> None:
    write_file(out / SUMMARY, to_csv(found).encode())
    text = "# Robustness\n\n" + "\n".join(each.to_markdown() for each in found)
    write_file(out / "sweep.md", text.encode())
    for each in found:
        plot_degradation(each, out / f"{each.part}-{each.name}.png")
