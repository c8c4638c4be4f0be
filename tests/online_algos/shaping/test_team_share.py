"""Shared rewards keep the team's mean and lie nearer to it."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.online_algos.shaping.shaped_env import TeamShare
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec


@settings(deadline=None)
@given(st.floats(0, 1))
def test_shares_keep_the_teams_mean(share: float) -> None:
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    rewards = np.arange(8, dtype=np.float32).reshape(2, 4)
    mixed = TeamShare(share).apply(rewards, step, step, 1.0)
    assert mixed.dtype == np.float32
    np.testing.assert_allclose(mixed.mean(1), rewards.mean(1), rtol=1e-5)
    np.testing.assert_allclose(np.ptp(mixed, axis=1), (1 - share) * 3, atol=1e-5)
