"""What robots hear of each other's places and targets."""

import numpy as np
import pytest

from swarmdata.behavior_policies.heard_goals import (
    HEARD_X,
    HEARD_Y,
    MASK,
    TARGET_X,
    TARGET_Y,
    HeardGoals,
)
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, Y, robots_of

SPEC = preset("search")


@pytest.mark.parametrize("observation", ["state", "lidar"])
def test_messages_are_read_in_the_frame_in_which_they_come(observation: str) -> None:
    robots = [{"robot": {"dynamics": "unicycle"}, "count": 4}]
    env = make_env(SPEC.with_updates(observation=observation, team=robots), 3)
    step = env.reset(np.arange(3, dtype=np.uint64))
    heard, states = HeardGoals(env.task).of(step), robots_of(step.states, 4)
    assert (heard[..., MASK] == 1.0).all()
    for i in range(4):
        np.testing.assert_allclose(heard[:, i, :, HEARD_X : HEARD_Y + 1], states[..., : Y + 1],
                                   atol=1e-5)  # fmt: skip
        np.testing.assert_allclose(heard[:, i, :, TARGET_X : TARGET_Y + 1], states[..., TX:],
                                   atol=1e-5)  # fmt: skip


@pytest.mark.parametrize("channel", ["none", "perfect", "learned-4"])
def test_without_targets_in_messages_robots_know_only_themselves(channel: str) -> None:
    env = make_env(SPEC.with_updates(communication=channel), 2)
    heard = HeardGoals(env.task).of(env.reset(np.arange(2, dtype=np.uint64)))
    np.testing.assert_array_equal(heard[..., MASK], np.broadcast_to(np.eye(4), (2, 4, 4)))
