"""Named sets of reward weights, by the kind of task."""

from collections.abc import Mapping

from swarmdata.errors import UnknownNameError
from swarmdata.specs.rules import Rules

RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, or the name of a set of them."""

SAFE_FACTORS: dict[str, dict[str, float]] = {
    "coop_nav": {"proximity": 5.0},
    "formation": {"proximity": 5.0},
    "transport": {"proximity": 5.0},
    "warehouse": {"proximity": 5.0},
}
"""Factors on weights that `safe` gives, for each kind of task.

`proximity` is the one term that is felt before a contact, in every step and in proportion to the
depth: it teaches robots to keep clear. The terms of contacts teach them not to move where a contact
threatens: on `coop_nav-medium-replay`, where `maddpg_bc` solved 60 % of the episodes and 31 % of
all cleanly, `proximity` times 5 made that 46 and 39 %, collisions (not contacts) times 3 made it 39
and 31 %, both with hardly a collision of robots (3,000 updates of 128 rows, 64 units, 2 seeds, 256
validation episodes).
"""


def chosen_weights(choice: RewardChoice, rules: Rules) -> dict[str, float | str]:
    """Returns new weights by name.

    Args:
        choice: these weights, or the name of a set: `safe`.
        rules: of the task, with its recorded weights.

    Raises:
        UnknownNameError: there is no such set.
    """
    if not isinstance(choice, str):
        return dict(choice)
    if choice != "safe":
        raise UnknownNameError("set of reward weights", choice, ("safe",))
    factors = SAFE_FACTORS[rules.task]
    return {name: factor * getattr(rules.rewards, name) for name, factor in factors.items()}
