"""The section of a card with the whole reward: every term, its weight, and how contacts count."""

from swarmdata.drawing.markdown import table
from swarmdata.interfaces import Task
from swarmdata.registry.components import reward_terms
from swarmdata.store.arrays.attributes import PRECISION_NOTE, REWARD_FORMULA
from swarmdata.types import EVENT_COLUMNS


def reward_section(task: Task) -> str:
    """Every term of a robot's reward with its numbers, and the events it is computed from."""
    terms = [
        (term.name, f"{term.weight:g}", term.formula, term.meaning) for term in reward_terms(task)
    ]
    events = [(f"`{column.name}`", column.meaning) for column in EVENT_COLUMNS]
    share = task.spec.rules.rewards.team_share
    return (
        "\n## Reward\n\n"
        + table(("term", "weight", "formula", "where"), terms)
        + f"\n{REWARD_FORMULA} Here team_share is {share:g}. {PRECISION_NOTE}\n\n"
        + table(("column of `events`", "meaning"), events)
        + f"\n{_counting(task)}\n"
    )


def _counting(task: Task) -> str:
    pushed = " Contacts with the payload are not in `events`." if task.movables else ""
    failing = (
        " A contact that begins fails the episode. If the task is solved in the same step, its "
        "success is rewarded, but the episode counts as failed."
        if task.spec.on_collision == "fail"
        else ""
    )
    return (
        "Gaps are distances between surfaces. `episodes/robot_collisions` counts a pair of robots "
        "once, `events` in the rows of both. `episodes/obstacle_collisions` is the sum over robots."
        f"{pushed}{failing}"
    )
