"""Named sets of reward weights."""

from collections.abc import Mapping

from swarmdata.errors import UnknownNameError
from swarmdata.specs.rules import TaskRules

RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, or the name of a set of them."""

SAFE_FACTORS: Mapping[str, float] = {"proximity": 5.0}
"""Factors on weights that `safe` gives.

`proximity` is the one term that is felt before a contact, in every step and in proportion to the
depth: it teaches robots to keep clear. The terms of contacts teach them not to move where a contact
threatens. `cards/studies/safe` and `safe-tasks` measure what they change.
"""

TEAM_WEIGHTS: Mapping[str, float] = {"team_share": 1.0}
"""Weights that `team` gives: every robot has the mean reward of the team, so that what each of them
contributes is not told."""


def chosen_weights(choice: RewardChoice, rules: TaskRules) -> dict[str, float | str]:
    """Returns new weights by name.

    Args:
        choice: these weights, or the name of a set: `safe` or `team`.
        rules: of the task, with its recorded weights.

    Raises:
        UnknownNameError: there is no such set.
    """
    if not isinstance(choice, str):
        return dict(choice)
    if choice == "team":
        return dict(TEAM_WEIGHTS)
    if choice != "safe":
        raise UnknownNameError("set of reward weights", choice, ("safe", "team"))
    return {name: factor * getattr(rules.rewards, name) for name, factor in SAFE_FACTORS.items()}
