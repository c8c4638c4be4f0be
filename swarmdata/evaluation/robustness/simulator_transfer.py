"""Evaluates policies in another simulator too, on the same seeds and layouts.

results/           result files of both simulators
simulators.csv     scores and counts side by side, their changes, and the agreement of the ranks

A task's spec says in which simulator its policies were trained or written. Scores of both are on
the scale of that one, so that a loss is visible. An interrupted comparison resumes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.evaluation.policy_selection.rank_statistics import ranking_quality
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    collect_evaluations,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import reference_of
from swarmdata.evaluation.robustness.sweep import RESULTS_FOLDER
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.registry.presets import name_of
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.runtime.output_folder import OutputKind, check_output, filled
from swarmdata.types import Double

COMPARISON = OutputKind("comparison of simulators")

TABLE_FILE = "simulators.csv"

LEAST_RANKED = 3
"""Policies from which on a rank correlation is computed."""


@dataclass(frozen=True, eq=False)
class TeamTransfer:
    """A team in two simulators; tables are [K policies, E episodes]."""

    task: str  # name of its preset, where the spec is one
    label: str  # of the team
    backends: tuple[str, str]  # the simulators, that of the task first
    known: tuple[Result, ...]  # result of each policy in the first simulator
    new: tuple[Result, ...]  # likewise in the second

    def metric(self, name: str) -> tuple[Double, Double]:
        """A metric of every episode in both simulators."""
        return _table(self.known, name), _table(self.new, name)

    def scores(self) -> tuple[Double, Double]:
        """The score of every episode in both simulators, on the scale of the first.

        Raises:
            SpecError: no references were measured in the task.
        """
        reference = reference_of(self.known[0].spec)
        if reference is None:
            raise SpecError(
                f"{self.task} has no score: no references were measured in it, expected a preset "
                "of cards/references.json. Name one of those with --task."
            )
        known, new = self.metric("return")
        return normalized_score(known, reference), normalized_score(new, reference)


def _table(results: Sequence[Result], name: str) -> Double:
    return np.stack([result.evaluation.metrics[name] for result in results])


def compare_simulators(
    names: Sequence[str],
    out: Path,
    *,
    backend: str = "mujoco",
    task: str | None = None,
    n_episodes: int = 200,
    **options: Unpack[JobOptions],
) -> list[TeamTransfer]:
    """Evaluates teams in their own simulator and in another one, and writes the table.

    All teams are found before anything is evaluated.

    Args:
        names: policies, tiers and run folders, as `find_target` takes them.
        out: folder; an interrupted comparison resumes in it.
        backend: the other simulator.
        task: preset or spec file in which they act, as `find_target` takes it.
        n_episodes: number of reserved seeds, the same for all.
        options: where policies are evaluated.

    Raises:
        OutputError: `out` has files that no comparison wrote.
        UnknownNameError: no such team, task or simulator.
        SpecError: a team has that simulator itself, or its task has no score.
        PolicyFitError: a team cannot act in the task.
        SwarmdataError: as `run_evaluations` says.
        MissingExtraError: a simulator is not installed.
    """
    check_output(out, COMPARISON, RESULTS_FOLDER)
    planned = [_plan(name, task, backend, n_episodes, out / RESULTS_FOLDER) for name in names]
    every = [each for pair in planned for found in pair for each in found]
    run_evaluations(every, **options)
    teams = [
        TeamTransfer(
            name_of(known[0].spec),
            known[0].provenance.label,
            (known[0].spec.backend, new[0].spec.backend),
            tuple(collect_evaluations(known)),
            tuple(collect_evaluations(new)),
        )
        for known, new in planned
    ]
    with filled(out, COMPARISON, besides=RESULTS_FOLDER) as folder:
        (folder / TABLE_FILE).write_text(transfer_table(teams), encoding="utf-8")
    return teams


def _plan(
    name: str, task: str | None, backend: str, n_episodes: int, results: Path
) -> tuple[list[Evaluation], list[Evaluation]]:
    """The evaluations of a team in its own simulator, and in the other."""
    sources = [TargetName.of(name, task, backend=each) for each in (None, backend)]
    known, new = (evaluations_of(each, each.find(), n_episodes, results) for each in sources)
    if known[0].spec.backend == new[0].spec.backend:
        raise SpecError(
            f"{name} acts in {backend} already, expected another simulator; name another one with "
            "--simulator"
        )
    return known, new


def rank_agreement(teams: Sequence[TeamTransfer]) -> Estimate | None:
    """Spearman's rank correlation of all policies' mean scores in both simulators.

    The interval is a bootstrap over policies (`rank_statistics`); None for fewer than
    `LEAST_RANKED` policies.
    """
    pairs = [team.scores() for team in teams]
    known = np.concatenate([each.mean(axis=1) for each, _ in pairs])
    new = np.concatenate([each.mean(axis=1) for _, each in pairs])
    if len(known) < LEAST_RANKED:
        return None
    return ranking_quality(known, new).spearman


CHANGE = "change"
"""Stands as the simulator of differences between the second and the first."""

COUNTS = ("success", "robot_collisions", "obstacle_collisions")


def transfer_table(teams: Sequence[TeamTransfer]) -> str:
    """Returns a row for each task, team, quantity and simulator, as CSV.

    Scores of both simulators are on the scale of the first, with 95 % intervals; changes are paired
    by policy and episode. The rank correlation is over all policies of a task, where there are
    enough; its interval is a bootstrap over policies, which share tasks, so it tends to be narrow.

    Args:
        teams: at least one, all with the same two simulators and number of episodes.
    """
    rows = [row for team in teams for row in _rows(team)]
    for task in dict.fromkeys(team.task for team in teams):
        ranks = rank_agreement([team for team in teams if team.task == task])
        if ranks is not None:
            rows.append(_row(task, "", 0, "rank_correlation", "", ranks))
    return to_csv(rows)


def _rows(team: TeamTransfer) -> list[dict[str, object]]:
    where = team.task, team.label, len(team.known)
    known, new = team.scores()
    scores = {
        team.backends[0]: mean_interval(known),
        team.backends[1]: mean_interval(new),
        CHANGE: mean_interval(new - known),
    }
    found = [_row(*where, "score", backend, each) for backend, each in scores.items()]
    for quantity in COUNTS:
        for backend, values in zip(team.backends, team.metric(quantity), strict=True):
            mean = Estimate(float(values.mean()), math.nan, math.nan)
            found.append(_row(*where, quantity, backend, mean))
    return found


def _row(
    task: str, team: str, policies: int, quantity: str, backend: str, found: Estimate
) -> dict[str, object]:
    return {
        "task": task,
        "team": team,
        "policies": policies or "",
        "quantity": quantity,
        "backend": backend,
        "mean": found.value,
        "low": found.low,
        "high": found.high,
    }
