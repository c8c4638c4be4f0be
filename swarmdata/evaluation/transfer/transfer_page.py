"""The page that compares policies in two simulators: scores, successes, collisions, ranks."""

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
    """Returns the page as Markdown.

    Args:
        teams: at least one, all with the same two simulators and number of episodes.
    """
    first, second = (TITLES[each] for each in teams[0].backends)
    n_episodes = teams[0].metric("return")[0].shape[1]
    sentences = "".join(f"- {sentence}\n" for sentence in _sentences(teams))
    tables = "".join(
        f"\n## {task}\n\n{_table([team for team in teams if team.task == task])}"
        for task in dict.fromkeys(team.task for team in teams)
    )
    command = (
        f"swarmdata transfer {' '.join(dict.fromkeys(team.label for team in teams))}"
        f"{''.join(f' --task {task}' for task in dict.fromkeys(team.task for team in teams))}"
        f" --backend {teams[0].backends[1]} --episodes {n_episodes} --results FOLDER --out FILE"
    )
    return (
        "# Do policies depend on the simulator?\n\n"
        f"The same policies, seeds and layouts in {first} and in {second}, whose contacts are "
        f"others. Nothing was trained in {second}. A score is on the scale of {first}'s "
        f"references; a collision is defined by distance, the same in both.\n\n{sentences}{tables}"
        "\n## Limits\n\n"
        f"{n_episodes} reserved episodes of each policy. Intervals are 95 % intervals; those of "
        f"means are for {TARGET_OF_SEVERAL} where a row has several policies, else for "
        f"{TARGET_OF_ONE}; differences are paired by policy and episode. That of a rank "
        "correlation is a bootstrap over policies, which share tasks and tiers, so it tends to be "
        f"too narrow. Made with {_versions(teams[0].backends)}; other versions of {second}, and "
        "other machines, may give other digits.\n\n"
        f"    {command}\n\nwrites this page.\n"
    )


def _sentences(teams: Sequence[TeamTransfer]) -> list[str]:
    first, second = (TITLES[each] for each in teams[0].backends)
    changes = [_difference(*team.scores()) for team in teams]
    lower = [t for t, c in zip(teams, changes, strict=True) if c.high < 0.0]
    higher = [t for t, c in zip(teams, changes, strict=True) if c.low > 0.0]
    rest = len(teams) - len(lower) - len(higher)
    found = [
        f"In {second}, the score of {len(lower)} of {len(teams)} teams is clearly lower than in "
        f"{first}{_named(lower)}, that of {len(higher)} clearly higher{_named(higher)}, and that "
        f"of {rest} neither."
    ]
    largest = max(range(len(teams)), key=lambda k: abs(changes[k].value))
    found.append(
        f"The largest change is that of {_name(teams[largest])}: {_signed(changes[largest], 1)}."
    )
    ranked = [
        (task, rank_agreement([team for team in teams if team.task == task]))
        for task in dict.fromkeys(team.task for team in teams)
    ]
    words = [f"{task} {_plain(found, 2)}" for task, found in ranked if found is not None]
    if words:
        found.append(
            f"Rank correlation of the policies' scores in {first} and {second}: {', '.join(words)}."
        )
    return found


def _named(teams: Sequence[TeamTransfer]) -> str:
    return f" ({', '.join(map(_name, teams))})" if teams else ""


def _name(team: TeamTransfer) -> str:
    return f"`{team.label}` in {team.task}"


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
