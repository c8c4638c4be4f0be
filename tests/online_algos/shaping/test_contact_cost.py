"""Contact costs grow during training and are those of the task's own contacts."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")


from swarmdata.online_algos.shaping.shaped_env import ContactCost
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

SPEC = TaskSpec()
WEIGHTS = SPEC.rules.rewards


def touching() -> Step:
    """Two copies; robot 1 of the first begins to touch a robot."""
    step = make_env(SPEC, 2).reset(np.arange(2, dtype=np.uint64))
    events = np.zeros_like(step.events)
    events[0, 1] = (1, 0, 1, 0)
    rewards = np.arange(8, dtype=np.float32).reshape(2, 4)
    return step._replace(events=events, rewards=rewards)


@pytest.mark.parametrize(("progress", "part"), [(0.1, 0.0), (0.4, 0.5), (0.6, 1.0), (1.0, 1.0)])
def test_the_cost_is_a_ramp_times_the_tasks_costs(progress: float, part: float) -> None:
    step = touching()
    rewards = ContactCost(WEIGHTS, 4.0, (0.2, 0.6)).apply(step.rewards, step, step, progress)
    expected = step.rewards.copy()
    expected[0, 1] -= part * 4.0 * (WEIGHTS.robot_contact + WEIGHTS.robot_collision)
    np.testing.assert_allclose(rewards, expected, rtol=1e-6)
    assert rewards.dtype == np.float32
