"""The scripted controller of `intersection` gets robots across, without a contact."""

import pytest

from swarmdata.registry.components import make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from tests.support.pairs import slow


@pytest.mark.parametrize("name", ["intersection", *slow("intersection-easy", "intersection-n8")])
def test_robots_get_across(name: str) -> None:
    spec = preset(name)
    policy = make_policy("scripted", spec)
    result = evaluate(policy, spec, name="scripted", n_episodes=20, progress=False)
    assert result.metrics["success"].mean() >= 0.85  # 0.9 and more in 1,000 episodes
    assert result.metrics["robot_collisions"].mean() <= 0.1
    assert result.metrics["obstacle_collisions"].mean() <= 0.1
