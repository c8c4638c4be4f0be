"""Evaluates trained policies under worse communication and sensing, with everything else fixed.

results/LABEL/trained/         results (`result_files`) with everything as in training
results/LABEL/PART-NAME-VALUE/ the same at one value of an axis
sweep.csv, sweep.md            every estimate; a table for each axis
PART-NAME.png                  a figure for each axis

A sweep that was stopped goes on where it was: results that are there are read, not measured again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from swarmdata.behavior_policies.learned import Learned
from swarmdata.errors import SpecError
from swarmdata.models import is_same_world
from swarmdata.report import Column
from swarmdata.result_files import Result
from swarmdata.spec import TaskSpec
from swarmdata.sweep_axes import Axis, Course, course_of
from swarmdata.sweep_estimates import estimates_of
from swarmdata.sweep_files import measured
from swarmdata.sweep_plots import plot_degradation
from swarmdata.sweep_tables import Degradation, Line, Point, to_csv
from swarmdata.targets import Target, find_target, require

TRAINED = "trained"
"""Folder of results with everything as in training."""

Results = dict[str, list[Result]]
"""Name of the folder -> one result per policy."""


@dataclass(frozen=True, eq=False)
class _Team:
    """What is swept, and where each axis leads it."""

    target: Target
    courses: tuple[Course, ...]  # one per axis


@dataclass(frozen=True, eq=False)
class _Place:
    """One spec to evaluate a team on."""

    name: str  # of the folder of its results
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
        SchemaError: a team cannot read what a value gives, or `out` holds other results.
        MissingExtraError: matplotlib, or torch for a run, is not installed.
    """
    require("matplotlib", "plots", "drawing the figures of a sweep")
    _check_axes(axes)
    teams = _teams(names, axes, task)
    n_all = sum(len(team.target.policies) * len(_places(team, axes)) for team in teams)
    results: list[Results] = []
    with tqdm(total=n_all, unit="evaluation", disable=None if progress else True) as bar:
        for team in teams:
            folder = out / "results" / team.target.label
            folder.mkdir(parents=True, exist_ok=True)
            found: Results = {}
            for place in _places(team, axes):
                bar.set_description(f"{team.target.label} {place.name}", refresh=False)
                for index in range(len(team.target.policies)):
                    there = folder / place.name
                    result = measured(team.target, index, place.spec, there, n_episodes)
                    found.setdefault(place.name, []).append(result)
                    bar.update()
            results.append(found)
    degradations = [_degradation(k, axes, teams, results, n_episodes) for k in range(len(axes))]
    _write(degradations, out)
    return degradations


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
    teams = []
    for name in names:
        target = find_target(name, task)
        _check_senses(target, name)
        courses = tuple(course_of(axis, name, target.spec) for axis in axes)
        teams.append(_Team(target, courses))
    first = teams[0].target
    for other in (team.target for team in teams[1:]):
        if not is_same_world(first.spec, other.spec):
            raise SpecError(
                f"{first.label} and {other.label} were trained in different worlds "
                f"({first.spec.task} and {other.spec.task}, or other rules, teams or arenas). "
                "Sweep them apart, each with its own --out."
            )
    labels = [team.target.label for team in teams]
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise SpecError(
            f"two of the teams are called {twice[0]!r}, so their results could not be told apart. "
            "Name one of them once, or rename a run's folder."
        )
    return teams


def _check_senses(target: Target, name: str) -> None:
    is_trained = any(isinstance(policy, Learned) for policy in target.policies)
    if target.provenances[0].run is None and not is_trained:
        raise SpecError(
            f"{name} does not act on what robots see and hear, so worse models cannot hurt it. "
            "Sweep trained policies: a run's folder, or a tier such as expert."
        )


def _places(team: _Team, axes: Sequence[Axis]) -> list[_Place]:
    """As trained first, then along each axis; a point of an axis may be as trained."""
    places = [_Place(TRAINED, team.target.spec)]
    for axis, course in zip(axes, team.courses, strict=True):
        for value, spec in zip(axis.values, course.specs, strict=True):
            if not _is_trained(value, spec, course, team):
                places.append(_Place(_name(axis, value), spec))
    return places


def _name(axis: Axis, value: float) -> str:
    return f"{axis.part}-{axis.name}-{value}"


def _is_trained(value: float, spec: TaskSpec, course: Course, team: _Team) -> bool:
    return value == course.trained or spec == team.target.spec


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
        for value, is_trained, name, spec in _along(axis, team, team.courses[k]):
            columns, estimates = estimates_of(found[name], found[TRAINED], spec, team.target.spec)
            points.append(Point(value, is_trained, estimates))
        lines.append(Line(team.target.label, len(team.target.policies), tuple(points)))
    return Degradation(axis.part, axis.name, columns, tuple(lines), n_episodes, axis.falls)


def _along(
    axis: Axis, team: _Team, course: Course
) -> Iterator[tuple[float | None, bool, str, TaskSpec]]:
    """Value, whether it is as trained, folder of the results, and spec of each point."""
    points: list[tuple[float | None, bool, str, TaskSpec]] = []
    for value, spec in zip(axis.values, course.specs, strict=True):
        if not _is_trained(value, spec, course, team):
            points.append((value, False, _name(axis, value), spec))
    points.append((course.trained, True, TRAINED, team.target.spec))
    sign = -1.0 if axis.falls else 1.0
    yield from sorted(points, key=lambda p: -np.inf if p[0] is None else sign * p[0])


def _write(found: Sequence[Degradation], out: Path) -> None:
    (out / "sweep.csv").write_text(to_csv(found), encoding="utf-8")
    text = "# Robustness\n\n" + "\n".join(each.to_markdown() for each in found)
    (out / "sweep.md").write_text(text, encoding="utf-8")
    for each in found:
        plot_degradation(each, out / f"{each.part}-{each.name}.png")
