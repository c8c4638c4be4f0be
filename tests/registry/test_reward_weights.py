"""Named sets of reward weights."""

import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.presets import preset
from swarmdata.registry.reward_weights import SAFE_FACTORS, chosen_weights
from swarmdata.specs.rules import changed_weights


@pytest.mark.parametrize("task", SAFE_FACTORS)
def test_safe_weights_are_larger_weights_of_contacts(task: str) -> None:
    rules = preset(task).rules
    weights = chosen_weights("safe", rules)
    changed = changed_weights(rules.rewards, weights)
    for name in weights:
        assert getattr(changed, name) > getattr(rules.rewards, name), name
    same = changed.model_copy(update={name: getattr(rules.rewards, name) for name in weights})
    assert same == rules.rewards


def test_what_is_not_there_is_refused() -> None:
    rules = preset("coop_nav").rules
    assert chosen_weights({"robot_collision": 2.0}, rules) == {"robot_collision": 2.0}
    with pytest.raises(UnknownNameError, match="unknown set of reward weights 'save'"):
        chosen_weights("save", rules)
    others = [name for name in ("formation", "transport", "warehouse") if name not in SAFE_FACTORS]
    for name in others:
        with pytest.raises(SpecError, match=f"no safe reward weights for {name}"):
            chosen_weights("safe", preset(name).rules)
