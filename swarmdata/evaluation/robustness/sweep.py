"""Evaluates policies under worse communication, sensing or bodies, with everything else fixed.

results/trained/            result files with everything as in training
results/PART-NAME-VALUE/    result files at one value of an axis
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np

from swarmdata.behavior_policies.simple import Idle, Random
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    collect_evaluations,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.policy_names import Target
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.robustness.sweep_axes import Axis, specs_along_axis
from swarmdata.evaluation.robustness.sweep_plots import plot_degradation
from swarmdata.evaluation.robustness.sweep_tables import (
    SWEEP_FILE,
    Degradation,
    Point,
    TeamLine,
    estimates_of,
    write_csv,
)
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.numerics.random import SeedBlock
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import OutputKind, check_output, filled, remove_others
from swarmdata.specs.model_choice import Ranges, is_same_world
from swarmdata.specs.task_spec import TaskSpec

SWEEP = OutputKind("sweep")

RESULTS_FOLDER = "results"

TRAINED_FOLDER = "trained"  # of results with everything as in training


class _SweepPoint(NamedTuple):
    """A spec to evaluate a team in."""

    value: float | None  # on the axis; None: as trained, which has no number
    folder: str  # of its results
    spec: TaskSpec


@dataclass(frozen=True, eq=False)
class _Team:
    """A team, its label, and its points along each axis."""

    label: str
    source: TargetName
    target: Target
    points: tuple[tuple[_SweepPoint, ...], ...]  # one row per axis, in the order of its values


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep that has been checked: what there is to evaluate."""

    axes: tuple[Axis, ...]  # parameters and their values
    out: Path  # folder of results, tables and figures
    n_episodes: int  # number of seeds, the same at every point
    block: SeedBlock  # of these seeds
    teams: tuple[_Team, ...]  # in the order of the tables

    def points(self) -> dict[str, list[Evaluation]]:
        """Name of a point, `TEAM/FOLDER` -> the evaluation of each policy of the team."""
        return {
            f"{team.label}/{folder}": found
            for team in self.teams
            for folder, found in self.evaluations(team).items()
        }

    def evaluations(self, team: _Team) -> dict[str, list[Evaluation]]:
        """Name of a folder -> the evaluation of each policy of a team, as trained first."""
        specs = {TRAINED_FOLDER: team.target.spec}
        specs |= {point.folder: point.spec for points in team.points for point in points}
        found, folder = (team.source, team.target, self.n_episodes), self.out / RESULTS_FOLDER
        return {
            name: evaluations_of(*found, folder / name, spec=spec, block=self.block)
            for name, spec in specs.items()
        }


def plan_sweep(
    names: Sequence[str],
    axes: Sequence[Axis],
    out: Path,
    *,
    n_episodes: int = 200,
    task: str | None = None,
    backend: str | None = None,
    randomization: Ranges | None = None,
    block: SeedBlock = "evaluation",
) -> Sweep:
    """Finds the teams and checks them, before anything is evaluated.

    Names, tasks, simulators and ranges are as `find_target` takes them; the seeds, the first of a
    block, are the same at every point. An interrupted sweep of the same teams resumes in `out`.
    """
    _check_axes(axes)
    check_output(out, SWEEP, RESULTS_FOLDER)
    shared = {"task": task, "backend": backend, "randomization": randomization}
    sources = [TargetName.parse({"name": name, **shared}) for name in names]
    return Sweep(tuple(axes), out, n_episodes, block, tuple(_teams(names, axes, sources)))


def run_point(planned: Sweep, name: str) -> bool:
    """Evaluates one point in this process, for schedulers; where it is done, nothing happens.

    Two processes may evaluate the same point: they write the same files. Returns whether it was not
    done yet.

    Raises:
        ResultsError: `out` has results of another run with the same name and dataset.
    """
    points = planned.points()
    if name not in points:
        raise UnknownNameError("point", name, points)
    return run_evaluations(points[name], progress=False) < len(points[name])


def run_sweep(planned: Sweep, **options: Unpack[JobOptions]) -> list[Degradation]:
    """Evaluates teams along axes, one parameter at a time, and writes tables and figures.

    Raises:
        SwarmdataError: as `run_evaluations` says.
        MissingExtraError: matplotlib is not installed.
    """
    require_extra("matplotlib", "plots", "drawing the figures of a sweep")
    every = [each for found in planned.points().values() for each in found]
    with locked(planned.out, options.get("progress", True)):
        run_evaluations(every, **options)
        return _collect(planned)


def collect_sweep(planned: Sweep) -> list[Degradation]:
    """Writes the tables and figures, and evaluates nothing; raises unless all points are done."""
    require_extra("matplotlib", "plots", "drawing the figures of a sweep")
    with locked(planned.out, shown=False):
        return _collect(planned)


def _collect(planned: Sweep) -> list[Degradation]:
    """Does what `collect_sweep` does, for a caller that holds the lock."""
    results = [
        {name: collect_evaluations(each) for name, each in planned.evaluations(team).items()}
        for team in planned.teams
    ]
    found = [_degradation(k, planned, results) for k in range(len(planned.axes))]
    text = "# Robustness\n\n" + "\n".join(each.to_markdown() for each in found)
    with filled(planned.out, SWEEP, besides=RESULTS_FOLDER) as folder:
        (folder / SWEEP_FILE).write_text(write_csv(found), encoding="utf-8")
        (folder / "sweep.md").write_text(text, encoding="utf-8")
        for each in found:
            plot_degradation(each, folder / f"{each.part}-{each.name}.png")
        kept = {path.name for path in folder.iterdir()}
    remove_others(planned.out, SWEEP, kept)
    return found


def _check_axes(axes: Sequence[Axis]) -> None:
    if not axes:
        raise SpecError(
            "there is nothing to sweep. Pass at least one axis, such as --communication "
            "drop=0..0.8, --observation noise=0..0.2 or --body max_acceleration=1.5..0.5."
        )
    swept = [axis.parameter for axis in axes]
    twice = [parameter for parameter in swept if swept.count(parameter) > 1]
    if twice:
        raise SpecError(f"{twice[0]} is swept twice. Put all its values into one axis.")


def _teams(
    names: Sequence[str], axes: Sequence[Axis], sources: Sequence[TargetName]
) -> list[_Team]:
    """Finds the teams, and checks all of them before any evaluation."""
    targets = [source.find() for source in sources]
    if any(axis.part != "body" for axis in axes):
        for name, target in zip(names, targets, strict=True):
            _check_senses(target, name)
    points = [
        tuple(_points(axis, name, target.spec) for axis in axes)
        for name, target in zip(names, targets, strict=True)
    ]
    teams = list(map(_Team, _labels(targets), sources, targets, points))
    first = teams[0]
    for other in teams[1:]:
        if not is_same_world(first.target.spec, other.target.spec):
            raise SpecError(
                f"{first.label} and {other.label} were trained in different worlds "
                f"({first.target.spec.task} and {other.target.spec.task}, or other rules, teams or "
                "arenas). Sweep them separately, each with its own --out."
            )
    return teams


def _labels(targets: Sequence[Target]) -> list[str]:
    """The labels of the teams, with their datasets if a label has several."""
    names = [target.label for target in targets]
    keys = [target.provenances[0].dataset_key for target in targets]
    both = list(zip(names, keys, strict=True))
    twice = next((pair for pair in both if both.count(pair) > 1), None)
    if twice is not None:
        raise SpecError(
            f"two of the teams are called {twice[0]!r}{f' on {twice[1]}' if twice[1] else ''}, so "
            "their results would have the same names. Pass each team once, or rename a run folder."
        )
    return [
        f"{name} on {key}" if key is not None and names.count(name) > 1 else name
        for name, key in both
    ]


def _check_senses(target: Target, name: str) -> None:
    if all(each.uses_state or isinstance(each, Idle | Random) for each in target.policies):
        raise SpecError(
            f"{name} does not use observations or messages, so worse models do not affect it. "
            "Sweep trained policies: a run folder, or a tier such as expert."
        )


def _degradation(k: int, planned: Sweep, results: Sequence[dict[str, list[Result]]]) -> Degradation:
    """The estimates of all teams along axis k, of results by the name of their folder."""
    axis = planned.axes[k]
    lines: list[TeamLine] = []
    columns: tuple[Column, ...] = ()
    for team, found in zip(planned.teams, results, strict=True):
        points = []
        trained = team.target.spec
        for value, folder, spec in team.points[k]:
            columns, estimates = estimates_of(found[folder], found[TRAINED_FOLDER], spec, trained)
            points.append(Point(value, folder == TRAINED_FOLDER, estimates))
        lines.append(TeamLine(team.label, len(team.target.policies), tuple(points)))
    as_trained = not any(team.source.changes_the_world for team in planned.teams)
    return Degradation(
        axis.part, axis.name, columns, tuple(lines), planned.n_episodes, axis.falls, as_trained,
        planned.block,
    )  # fmt: skip


def _points(axis: Axis, policy: str, trained: TaskSpec) -> tuple[_SweepPoint, ...]:
    """The points of an axis in its order, with the trained one (first if it has no number)."""
    along = specs_along_axis(axis, policy, trained)
    points = [
        _SweepPoint(value, f"{axis.part}-{axis.name}-{value}", spec)
        for value, spec in zip(axis.values, along.specs, strict=True)
        if value != along.trained and spec != trained
    ]
    points.append(_SweepPoint(along.trained, TRAINED_FOLDER, trained))
    sign = -1.0 if axis.falls else 1.0
    return tuple(sorted(points, key=lambda p: -np.inf if p.value is None else sign * p.value))
