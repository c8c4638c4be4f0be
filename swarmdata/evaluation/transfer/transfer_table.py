"""The table that compares policies in two simulators: scores, successes, collisions, ranks."""

import math
from collections.abc import Sequence

from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.transfer.simulator_transfer import TeamTransfer, rank_agreement
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate

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
