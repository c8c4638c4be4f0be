"""Tables that compare policies in two simulators: scores, successes, collisions, ranks."""

from collections.abc import Sequence
from importlib.metadata import version

from swarmdata.drawing import markdown
from swarmdata.evaluation.transfer.simulator_transfer import TeamTransfer, rank_agreement
from swarmdata.rollouts.score_intervals import (
    TARGET_OF_ONE,
    TARGET_OF_SEVERAL,
    mean_interval,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double

_MINUS = "\u2212"  # as in all our tables

TITLES = {"pymunk": "Pymunk", "mujoco": "MuJoCo", "kinematic": "a world without contacts"}
"""Simulators as texts call them."""


def transfer_page(teams: Sequence[TeamTransfer]) -> str:
    """Returns the tables, and what they were made with, as Markdown.

    Args:
        teams: at least one, all with the same two simulators and number of episodes.
    """
    tasks = list(dict.fromkeys(team.task for team in teams))
    by_task = {task: [team for team in teams if team.task == task] for task in tasks}
    n_episodes = teams[0].metric("return")[0].shape[1]
    tables = "\n".join(f"## {task}\n\n{_table(found)}" for task, found in by_task.items())
    ranks = [
        (task, _plain(found, 2))
        for task in tasks
        if (found := rank_agreement(by_task[task])) is not None
    ]
    correlations = markdown.table(("task", "rank correlation of scores"), ranks, is_numeric=True)
    command = (
        f"swarmdata transfer {' '.join(dict.fromkeys(team.label for team in teams))}"
        f"{''.join(f' --task {task}' for task in tasks)}"
        f" --backend {teams[0].backends[1]} --episodes {n_episodes} --results FOLDER --out FILE"
    )
    ranked = f"\n## Ranks\n\n{correlations}" if ranks else ""
    return (
        f"{tables}{ranked}\n## How it was measured\n\n"
        f"{n_episodes} reserved episodes of each policy. Scores of both simulators are on the "
        "scale of the first. Intervals are 95 % intervals; those of means are for "
        f"{TARGET_OF_SEVERAL} where a row has several policies, else for {TARGET_OF_ONE}; "
        "differences are paired by policy and episode. That of a rank correlation is a bootstrap "
        "over policies, which share tasks and tiers, so it tends to be too narrow. Made with "
        f"{_versions(teams[0].backends)}.\n\n    {command}\n"
    )


def _table(teams: Sequence[TeamTransfer]) -> str:
    first, second = (TITLES[each] for each in teams[0].backends)
    head = ["team", "policies"]
    head += [f"score, {each}" for each in (first, second)] + ["change"]
    head += [f"success (%), {each}" for each in (first, second)]
    head += [f"robot collisions, {each}" for each in (first, second)]
    head += [f"obstacle collisions, {each}" for each in (first, second)]
    rows = []
    for team in teams:
        known, new = team.scores()
        row = [team.label, str(len(team.known)), _plain(mean_interval(known), 1)]
        row += [_plain(mean_interval(new), 1), _signed(_difference(known, new), 1)]
        row += [f"{100 * float(each.mean()):.1f}" for each in team.metric("success")]
        for name in ("robot_collisions", "obstacle_collisions"):
            row += [f"{float(each.mean()):.2f}" for each in team.metric(name)]
        rows.append(row)
    return markdown.table(head, rows, is_numeric=True)


def _difference(known: Double, new: Double) -> Estimate:
    """The change from the first to the second simulator, paired by policy and episode."""
    return mean_interval(new - known)


def _plain(found: Estimate, decimals: int) -> str:
    value, low, high = (round(each, decimals) + 0.0 for each in found)  # no -0.0
    text = f"{value:.{decimals}f} [{low:.{decimals}f}, {high:.{decimals}f}]"
    return text.replace("-", _MINUS)


def _signed(found: Estimate, decimals: int) -> str:
    text = _plain(found, decimals)
    return text if text.startswith(_MINUS) else f"+{text}"


def _versions(backends: Sequence[str]) -> str:
    packages = ["swarmdata", *(each for each in backends if each != "kinematic")]
    return ", ".join(f"{name} {version(name)}" for name in packages)
