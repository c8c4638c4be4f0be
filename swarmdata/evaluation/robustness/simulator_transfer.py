"""Evaluates policies in another simulator than the task's too, on the same seeds and layouts."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.evaluation.policy_selection.rank_statistics import rank_correlation
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    collect_evaluations,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.result_set import Case, reference_of
from swarmdata.evaluation.robustness.sweep import RESULTS_FOLDER
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.numerics.random import SeedBlock
from swarmdata.registry.presets import name_of
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.runtime.output_folder import OutputKind, check_output, filled
from swarmdata.types import Double

COMPARISON = OutputKind("comparison of simulators")

TABLE_FILE = "simulators.csv"

LEAST_RANKED = 3  # policies from which on a rank correlation is computed


class TeamTransfer(NamedTuple):
    """A team in two simulators."""

    task: str  # name of its preset, where the spec is one
    label: str  # of the team
    cases: Mapping[str, Case]  # by simulator, that of the task first, whose scale scores have

    def scores(self) -> list[Double]:
        """The score of every episode in both simulators, [K policies, E episodes] each."""
        return [case.scores(self.label) for case in self.cases.values()]


def compare_simulators(
    names: Sequence[str],
    out: Path,
    *,
    backend: str = "mujoco",
    task: str | None = None,
    n_episodes: int = 200,
    block: SeedBlock = "evaluation",
    **options: Unpack[JobOptions],
) -> list[TeamTransfer]:
    """Evaluates teams in their own simulator and in another one, and writes the table.

    All teams are found before anything is evaluated. Names and tasks are as `find_target` takes
    them; the seeds, the first of a block, are the same for all. `out` gets the results of both
    simulators and the table; an interrupted comparison resumes in it.
    """
    check_output(out, COMPARISON, RESULTS_FOLDER)
    seeds = n_episodes, out / RESULTS_FOLDER, block
    planned = [_plan(name, task, backend, *seeds) for name in names]
    every = [each for pair in planned for found in pair for each in found]
    run_evaluations(every, **options)
    teams = [_team(*each) for each in planned]
    with filled(out, COMPARISON, besides=RESULTS_FOLDER) as folder:
        (folder / TABLE_FILE).write_text(transfer_table(teams), encoding="utf-8")
    return teams


def _plan(
    name: str, task: str | None, backend: str, n_episodes: int, results: Path, block: SeedBlock
) -> tuple[list[Evaluation], list[Evaluation]]:
    """The evaluations of a team in its own simulator, and in the other."""
    sources = [
        TargetName.parse({"name": name, "task": task, "backend": each}) for each in (None, backend)
    ]
    known, new = (
        evaluations_of(each, each.find(), n_episodes, results, block=block) for each in sources
    )
    spec = known[0].spec
    if spec.backend == new[0].spec.backend:
        raise SpecError(
            f"{name} acts in {backend} already, expected another simulator; name another one with "
            "--simulator"
        )
    if reference_of(spec) is None:
        raise SpecError(
            f"{name_of(spec)} has no score: no references were measured in it, expected a preset "
            "of cards/references.json. Name one of those with --task."
        )
    return known, new


def _team(known: Sequence[Evaluation], new: Sequence[Evaluation]) -> TeamTransfer:
    label, spec = known[0].provenance.label, known[0].spec
    cases: dict[str, Case] = {}
    for each in (known, new):
        runs = {label: tuple(collect_evaluations(each))}
        cases[each[0].spec.backend] = Case(None, each[0].spec, reference_of(spec), None, runs)
    return TeamTransfer(name_of(spec), label, cases)


def rank_agreement(teams: Sequence[TeamTransfer]) -> Estimate | None:
    """Spearman's rank correlation of all policies' mean scores in both simulators.

    None for fewer than `LEAST_RANKED` policies.
    """
    means = [[each.mean(axis=1) for each in team.scores()] for team in teams]
    known, new = (np.concatenate(each) for each in zip(*means, strict=True))
    return rank_correlation(known, new) if len(known) >= LEAST_RANKED else None


CHANGE = "change"  # stands as the simulator of differences between the second and the first

COUNTS = ("success", "robot_collisions", "obstacle_collisions")


def transfer_table(teams: Sequence[TeamTransfer]) -> str:
    """Returns a row for each task, team, quantity and simulator, as CSV.

    Scores of both simulators are on the scale of the first, with 95 % intervals; changes are paired
    by policy and episode. The rank correlation is over all policies of a task, where there are
    enough; its interval is a bootstrap over policies, which share tasks, so it tends to be narrow.
    """
    rows: list[tuple[object, ...]] = []
    for team in teams:
        where = team.task, team.label, len(team.scores()[0])
        rows += [(*where, *what, *found) for what, found in _estimates(team).items()]
    for task in dict.fromkeys(team.task for team in teams):
        ranks = rank_agreement([team for team in teams if team.task == task])
        if ranks is not None:
            rows.append((task, "", "", "rank_correlation", "", *ranks))
    keys = ("task", "team", "policies", "quantity", "backend", "mean", "low", "high")
    return to_csv([dict(zip(keys, row, strict=True)) for row in rows])


def _estimates(team: TeamTransfer) -> dict[tuple[str, str], Estimate]:
    known, new = team.scores()
    scores = zip((*team.cases, CHANGE), (known, new, new - known), strict=True)
    found = {("score", name): mean_interval(values) for name, values in scores}
    for quantity in COUNTS:
        for backend, case in team.cases.items():
            mean = float(case.metric(team.label, quantity).mean())
            found[quantity, backend] = Estimate(mean, math.nan, math.nan)
    return found
