"""Named sets of reward weights, by the kind of task."""

from collections.abc import Mapping

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.rules import Rules

RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, or the name of a set of them."""

SAFE_FACTORS: dict[str, dict[str, float]] = {
    task: {"proximity": 5.0}
    for task in ("coop_nav", "formation", "transport", "warehouse", "intersection", "search")
}
"""Factors on weights that `safe` gives, for each kind of task.

`proximity` is the one term that is felt before a contact, in every step and in proportion to the
depth: it teaches robots to keep clear. The terms of contacts teach them not to move where a contact
threatens. `cards/studies/safe` and `safe-tasks` measure what they change.
"""


def chosen_weights(choice: RewardChoice, rules: Rules) -> dict[str, float | str]:
    """Returns new weights by name.

    Args:
        choice: these weights, or the name of a set: `safe`.
        rules: of the task, with its recorded weights.

    Raises:
        UnknownNameError: there is no such set.
        SpecError: the set is not for tasks of this kind.
    """
    if not isinstance(choice, str):
        return dict(choice)
    if choice != "safe":
        raise UnknownNameError("set of reward weights", choice, ("safe",))
    if rules.task not in SAFE_FACTORS:
        raise SpecError(
            f"the set 'safe' has no factors for {rules.task}, only for {', '.join(SAFE_FACTORS)}; "
            "name the weights, such as proximity=0.5"
        )
    factors = SAFE_FACTORS[rules.task]
    return {name: factor * getattr(rules.rewards, name) for name, factor in factors.items()}
