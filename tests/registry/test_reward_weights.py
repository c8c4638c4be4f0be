"""Named sets of reward weights."""

import pytest

from swarmdata.registry.components import TASKS
from swarmdata.registry.presets import preset
from swarmdata.specs.rules import changed_weights, chosen_weights

BEFORE_OR_AT_CONTACT = {
    "proximity", "robot_contact", "obstacle_contact", "robot_collision", "obstacle_collision",
}  # fmt: skip
"""Weights of what is unsafe."""


@pytest.mark.parametrize("task", TASKS)
def test_safe_weights_make_what_is_unsafe_dearer_and_leave_the_rest(task: str) -> None:
    rules = preset(task).rules
    weights = chosen_weights("safe", rules)
    changed = changed_weights(rules.rewards, weights)
    assert weights.keys() <= BEFORE_OR_AT_CONTACT
    for name in weights:
        assert getattr(changed, name) > getattr(rules.rewards, name), name
    same = changed.model_copy(update={name: getattr(rules.rewards, name) for name in weights})
    assert same == rules.rewards


@pytest.mark.parametrize("task", TASKS)
def test_a_team_shares_its_whole_reward(task: str) -> None:
    rules = preset(task).rules
    changed = changed_weights(rules.rewards, chosen_weights("team", rules))

    assert changed == rules.rewards.model_copy(update={"team_share": 1.0})
