"""Named sets of reward weights, by the kind of task."""

from collections.abc import Mapping

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.rules import Rules

RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, or the name of a set of them."""

SAFE_FACTORS: dict[str, dict[str, float]] = {
    "coop_nav": {"proximity": 5.0},
    "formation": {"proximity": 5.0},
    "transport": {"proximity": 5.0},
    "warehouse": {"proximity": 5.0},
    "intersection": {"proximity": 5.0},
    "search": {"proximity": 5.0},
}
"""Factors on weights that `safe` gives, for each kind of task.

`proximity` is the one term that is felt before a contact, in every step and in proportion to the
depth: it teaches robots to keep clear. The terms of contacts teach them not to move where a contact
threatens. On `coop_nav-medium-replay` (`cards/studies/safe`), `maddpg_bc` collides a third as often
with these factors and solves fewer episodes, clean ones too: .45 with recorded rewards, .32 with
these. In shorter trials, collisions times 3 left as many clean episodes and a third fewer solved.

The factors of `formation`, `transport` and `warehouse` are those of `coop_nav`. On their minis,
they changed nothing clearly in 1,500 updates of 2 seeds (`cards/studies/safe-tasks`). Those of
`intersection` and `search` are the same and were not tried.
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
