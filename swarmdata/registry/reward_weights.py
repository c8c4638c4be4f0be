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
}
"""Factors on weights that `safe` gives, for each kind of task.

`proximity` is the one term that is felt before a contact, in every step and in proportion to the
depth: it teaches robots to keep clear. The terms of contacts teach them not to move where a contact
threatens. `maddpg_bc` on `coop_nav-medium-replay`, 3,000 updates of 128 rows, hidden sizes 128 of
actors and 64 of critics, 2 seeds, 256 validation episodes, collisions an episode:

                        score  success  clean  with robots  with obstacles
    recorded             68.3      .60    .31          .34            1.37
    proximity x 5        66.0      .46    .39          .05             .92
    proximity x 10       59.8      .34    .30          .01             .60
    collisions x 3       58.9      .39    .31          .00             .99

With 4,500 updates, 5 seeds and 1,000 episodes (`cards/studies/safe`) it halves collisions and costs
success, clean success too: .38 with recorded rewards, .31 with these.

The factors of `formation`, `transport` and `warehouse` are those of `coop_nav`; what they buy was
not measured.
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
