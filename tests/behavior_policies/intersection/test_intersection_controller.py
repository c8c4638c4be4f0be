"""The scripted controller of `intersection` gets robots across, without a contact."""

import pytest

from swarmdata.behavior_policies.intersection.intersection_controller import (
    IntersectionController,
)
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy


@pytest.mark.parametrize("name", ["intersection", "intersection-easy", "intersection-n8"])
def test_robots_get_across(name: str) -> None:
    spec = preset(name)
    policy = make_policy("scripted", spec)
    result = evaluate(policy, spec, name="scripted", n_episodes=40, progress=False)
    assert result.metrics["success"].mean() >= 0.85  # 0.9 and more in 1,000 episodes
    assert result.metrics["robot_collisions"].mean() <= 0.1
    assert result.metrics["obstacle_collisions"].mean() <= 0.1


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_contract_holds(noise: float) -> None:
    spec = preset("intersection").with_updates(horizon=40)
    check_policy(IntersectionController(spec, noise=noise), spec, make_env)


def test_the_spec_of_another_task_is_refused() -> None:
    with pytest.raises(SpecError, match="expected 'intersection'"):
        IntersectionController(TaskSpec())
