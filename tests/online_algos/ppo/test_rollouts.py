"""The views of states that critics get, and last steps by seed."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.online_algos.ppo.rollouts import STATE_SCALE, critic_states, pad_by_seed, ranks
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec


def test_each_robot_sees_its_own_state_first() -> None:
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    views = critic_states(step, 0).reshape(2, 4, 4, 8)
    rows = step.states.reshape(2, 4, 8) * STATE_SCALE
    for robot in range(4):
        np.testing.assert_array_equal(views[:, robot], np.roll(rows, -robot, axis=1))


@settings(deadline=None)
@given(st.lists(st.integers(0, 3), min_size=1, max_size=30))
def test_padding_loses_nothing(seeds: list[int]) -> None:
    owners = np.array(seeds)
    values = np.random.default_rng(0).normal(size=(len(seeds), 2)).astype(np.float32)
    padded = pad_by_seed(values, owners, 4)
    np.testing.assert_array_equal(padded[owners, ranks(owners)], values)
    np.testing.assert_allclose(padded.sum((0, 1)), values.sum(0), atol=1e-5)
