"""Named sets of reward weights, by the kind of task."""

from collections.abc import Mapping

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.rules import Rules

RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, or the name of a set of them."""

SAFE_FACTORS: dict[str, dict[str, float]] = {
    "coop_nav": {
        "robot_contact": 5.0,
        "robot_collision": 5.0,
        "obstacle_contact": 5.0,
        "obstacle_collision": 5.0,
        "proximity": 5.0,
    },
}
"""Factors on the weights of contacts that `safe` gives, for each kind of task."""


def chosen_weights(choice: RewardChoice, rules: Rules) -> dict[str, float | str]:
    """Returns new weights by name.

    Args:
        choice: these weights, or the name of a set: `safe`.
        rules: of the task, with its recorded weights.

    Raises:
        UnknownNameError: there is no such set.
        SpecError: this kind of task has no such set.
    """
    if not isinstance(choice, str):
        return dict(choice)
    if choice != "safe":
        raise UnknownNameError("set of reward weights", choice, ("safe",))
    if rules.task not in SAFE_FACTORS:
        raise SpecError(
            f"there are no safe reward weights for {rules.task}, expected one of "
            f"{', '.join(SAFE_FACTORS)}; give weights by name, such as "
            '{"robot_collision": 2.0}.'
        )
    factors = SAFE_FACTORS[rules.task]
    return {name: factor * getattr(rules.rewards, name) for name, factor in factors.items()}
