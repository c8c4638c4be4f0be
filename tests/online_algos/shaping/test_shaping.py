"""Rewards to train on: costs of contacts that grow, and shares of the team."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.online_algos.mappo import MAPPOConfig
from swarmdata.online_algos.shaping.shaping import Shaping
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

SPEC = TaskSpec()
WEIGHTS = SPEC.rules.rewards
PLAIN = Shaping(
    contact_cost=0.0, contact_ramp=(0.0, 1.0), keep_right=0.0, keep_left=0.0, team_share=0.0
)


def touching() -> Step:
    """Two copies; robot 1 of the first begins to touch a robot."""
    step = make_env(SPEC, 2).reset(np.arange(2, dtype=np.uint64))
    events = np.zeros_like(step.events)
    events[0, 1] = (1, 0, 1, 0)
    rewards = np.arange(8, dtype=np.float32).reshape(2, 4)
    return step._replace(events=events, rewards=rewards)


def test_without_changes_rewards_are_the_tasks() -> None:
    step = touching()
    np.testing.assert_array_equal(PLAIN.rewards(step, WEIGHTS, 0.5), step.rewards)


@settings(deadline=None)
@given(st.floats(-1, 2), st.floats(0.01, 2), st.floats(0, 1), st.floats(0, 1))
def test_costs_never_fall_while_training_goes_on(
    begin: float, length: float, early: float, late: float
) -> None:
    shaping = replace(PLAIN, contact_cost=4.0, contact_ramp=(begin, begin + length))
    step = touching()
    first, last = (shaping.rewards(step, WEIGHTS, p) for p in sorted((early, late)))
    assert (last <= first).all()
    assert (first <= step.rewards).all()
    least = step.rewards[0, 1] - 4.0 * (WEIGHTS.robot_contact + WEIGHTS.robot_collision)
    assert last[0, 1] >= least - 1e-5
    np.testing.assert_array_equal(np.delete(last.ravel(), 1), np.delete(step.rewards.ravel(), 1))


@settings(deadline=None)
@given(st.floats(0, 1))
def test_shares_keep_the_teams_mean(share: float) -> None:
    step = touching()
    mixed = replace(PLAIN, team_share=share).rewards(step, WEIGHTS, 1.0)
    assert mixed.dtype == np.float32
    np.testing.assert_allclose(mixed.mean(1), step.rewards.mean(1), rtol=1e-5)
    assert (np.ptp(mixed, axis=1) <= np.ptp(step.rewards, axis=1) + 1e-5).all()


def test_a_config_has_all_of_it() -> None:
    config = MAPPOConfig(contact_cost=2.0, keep_right=0.5)
    shaping = Shaping.of(config)
    assert (shaping.contact_cost, shaping.keep_right) == (2.0, 0.5)
    assert (shaping.contact_ramp, shaping.team_share) == (config.contact_ramp, config.team_share)


@pytest.mark.parametrize("ramp", [(0.5,), (0.5, 0.5), (0.7, 0.2), (0.1, 0.2, 0.3)])
def test_a_ramp_has_two_ends(ramp: tuple[float, ...]) -> None:
    with pytest.raises(SchemaError, match="begin before end"):
        replace(PLAIN, contact_ramp=ramp)


def test_a_share_is_a_part() -> None:
    with pytest.raises(SchemaError, match="team_share is 1"):
        replace(PLAIN, team_share=1.5)
