"""The section of a card with the whole reward: every term, its weight, and how contacts count."""

from swarmdata.drawing.markdown import table
from swarmdata.interfaces import Task
from swarmdata.registry.components import reward_terms
from swarmdata.store.arrays.attributes import PRECISION_NOTE, REWARD_FORMULA
from swarmdata.types import EVENT_COLUMNS

SINGLE_ROBOT_NOTE = (
    "Each robot has a target of its own, and team_share is 0. So its reward depends on the others "
    "only through contacts and proximity, and through the end of the episode, when success is "
    "rewarded."
)
"""What the reward says of cooperation where no term is shared."""

STORED_NOTE = (
    "The values of the terms, without weights and signs, are stored as `reward_terms` [T, N, R] in "
    "this order: `dataset[0].reward_terms`. Rewards with other weights are a view: "
    "`dataset.with_rewards(robot_collision=2.0)`."
)
"""How to read the terms."""


def reward_section(task: Task) -> str:
    """Every term of a robot's reward with its numbers, and the events it is computed from."""
    terms = [
        (term.name, f"{term.weight:g}", f"`{term.formula}`", term.meaning)
        for term in reward_terms(task)
    ]
    events = [(f"`{column.name}`", column.meaning) for column in EVENT_COLUMNS]
    share = task.spec.rules.rewards.team_share
    counting = (
        "Gaps are distances between surfaces. `episodes/robot_collisions` counts a pair of robots "
        "once, `events` in the rows of both. `episodes/obstacle_collisions` is the sum over robots."
    )
    if task.spec.rules.has_own_targets and not share:
        counting = f"{SINGLE_ROBOT_NOTE}\n\n{counting}"
    if task.movables:
        counting += " Contacts with the payload are not in `events`."
    if task.spec.on_collision == "fail":
        counting += (
            " A contact that begins fails the episode. If the task is solved in the same step, its "
            "success is rewarded, but the episode counts as failed."
        )
    return (
        "\n## Reward\n\n"
        + table(("term", "weight", "formula", "where"), terms)
        + f"\n{REWARD_FORMULA} Here team_share is {share:g}. {STORED_NOTE} {PRECISION_NOTE}\n\n"
        + table(("column of `events`", "meaning"), events)
        + f"\n{counting}\n"
    )
