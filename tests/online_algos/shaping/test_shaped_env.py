"""Shaped rewards: nothing without terms, and every term in its order."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.online_algos.shaping.payload_potentials import PayloadPotential
from swarmdata.online_algos.shaping.shaped_env import (
    ShapedEnv,
    ShapingConfig,
    count_oncoming,
    less_contacts,
    less_oncoming,
    shape_rewards,
    with_team_share,
)
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.rules import Side
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

SPEC = TaskSpec(horizon=6)
NOTHING = ShapingConfig(contact_cost=0.0, team_share=0.0)


class Doubled:
    """Doubles rewards, and remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[Step, Step, float]] = []

    def __call__(self, rewards: Float, before: Step, after: Step, progress: float) -> Float:
        self.asked.append((before, after, progress))
        return 2 * rewards


def increased(rewards: Float, before: Step, after: Step, progress: float) -> Float:
    return rewards + np.float32(1)


@pytest.mark.parametrize("config", [None, NOTHING])
def test_without_terms_it_is_the_bare_environment(config: ShapingConfig | None) -> None:
    """Random steps too, with resets of the copies that end."""
    inner, generator = make_env(SPEC, 3), np.random.default_rng(0)
    env = ShapedEnv(inner, []) if config is None else shape_rewards(inner, config)
    assert env.terms == ()
    for name in ("spec", "task", "n_copies", "features", "action_size", "state_size"):
        assert getattr(env, name) is getattr(inner, name), name
    assert env.observation_size == inner.observation_size
    bare = make_env(SPEC, 3)
    seeds = np.arange(3, dtype=np.uint64)
    pairs = [(env.reset(seeds), bare.reset(seeds))]
    for t in range(15):
        actions = generator.uniform(-1, 1, (3, 4, 2))
        pairs.append((env.step(actions), bare.step(actions)))
        copies = np.flatnonzero(pairs[-1][0].ended)
        if len(copies):
            new = np.full(len(copies), 10 + t, np.uint64)
            pairs.append((env.reset(new, copies), bare.reset(new, copies)))
    for ours, theirs in pairs:
        for name in Step._fields:
            mine, other = getattr(ours, name), getattr(theirs, name)
            np.testing.assert_array_equal(mine, other, err_msg=name)


def test_terms_change_rewards_in_order_and_nothing_else() -> None:
    doubled, env = Doubled(), make_env(SPEC, 2)
    shaped, bare = ShapedEnv(env, [doubled, increased]), make_env(SPEC, 2)
    seeds = np.arange(2, dtype=np.uint64)
    before, _ = shaped.reset(seeds), bare.reset(seeds)
    shaped.progress = 0.25
    actions = np.full((2, 4, 2), 0.5)
    after, plain = shaped.step(actions), bare.step(actions)
    np.testing.assert_array_equal(after.rewards, 2 * plain.rewards + 1)
    for name in set(Step._fields) - {"rewards"}:
        np.testing.assert_array_equal(getattr(after, name), getattr(plain, name), err_msg=name)
    ((asked_before, asked_after, progress),) = doubled.asked
    assert asked_before is before
    np.testing.assert_array_equal(asked_after.states, after.states)
    assert progress == 0.25


def test_copies_that_are_not_reset_keep_their_shaped_rewards() -> None:
    shaped = ShapedEnv(make_env(SPEC, 3), [increased])
    shaped.reset(np.arange(3, dtype=np.uint64))
    rewards = shaped.step(np.zeros((3, 4, 2))).rewards
    after = shaped.reset(np.array([9], np.uint64), np.array([1])).rewards
    np.testing.assert_array_equal(after[[0, 2]], rewards[[0, 2]])
    assert (after[1] == 0).all()


def test_a_config_decides_the_terms_and_their_order() -> None:
    config = ShapingConfig(
        keep_left=0.5, payload_path_weight=2.0, behind_payload_weight=1.0,
        reward_weights=("progress=0",),
    )  # fmt: skip
    shaped = shape_rewards(make_env(preset("transport"), 1), config)
    contact, passing, share, potential = shaped.terms
    assert shaped.spec.rules.rewards.model_dump()["progress"] == 0
    assert isinstance(contact, partial)
    assert (contact.func, contact.keywords["cost"]) == (less_contacts, 1.5)
    assert contact.keywords["ramp"] == (0.2, 0.75)
    assert isinstance(passing, partial)
    assert passing.func is less_oncoming
    assert isinstance(share, partial)
    assert (share.func, share.keywords) == (
        with_team_share, {"share": 0.3, "sides": shaped.spec.sides},
    )  # fmt: skip
    assert isinstance(potential, PayloadPotential)


def test_a_ramp_has_two_ends_and_a_share_is_a_part() -> None:
    for ramp in ((0.5,), (0.5, 0.5), (0.7, 0.2), (0.1, 0.2, 0.3)):
        with pytest.raises(SchemaError, match="begin before end"):
            ShapingConfig(contact_ramp=ramp)
    with pytest.raises(SchemaError, match="team_share is 1"):
        ShapingConfig(team_share=1.5)


WEIGHTS = TaskSpec().rules.rewards


def touching() -> Step:
    """Two copies; robot 1 of the first begins to touch a robot."""
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    events = np.zeros_like(step.events)
    events[0, 1] = (1, 0, 1, 0)
    rewards = np.arange(8, dtype=np.float32).reshape(2, 4)
    return step._replace(events=events, rewards=rewards)


@pytest.mark.parametrize(("progress", "part"), [(0.1, 0.0), (0.4, 0.5), (0.6, 1.0), (1.0, 1.0)])
def test_the_cost_is_a_ramp_times_the_tasks_costs(progress: float, part: float) -> None:
    step = touching()
    rewards = less_contacts(
        step.rewards, step, step, progress, weights=WEIGHTS, cost=4.0, ramp=(0.2, 0.6)
    )
    expected = step.rewards.copy()
    expected[0, 1] -= part * 4.0 * (WEIGHTS.robot_contact + WEIGHTS.robot_collision)
    np.testing.assert_allclose(rewards, expected, rtol=1e-6)
    assert rewards.dtype == np.float32


Sides = tuple[list[float], list[float]]


def meeting_step(offset: float, speed: float, angle: float, gap: float) -> Step:
    """Robot 0 drives along x, robot 1 comes towards it at an offset; all is turned by an angle."""
    step = make_env(TaskSpec(), 1).reset(np.zeros(1, np.uint64))
    robots = np.zeros((4, 8))
    robots[2:, :2] = [[1.5, 1.5], [-1.5, -1.5]]
    robots[1, :2] = gap, offset
    robots[0, 2], robots[1, 2] = speed, -speed
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    robots[:, :2], robots[:, 2:4] = robots[:, :2] @ turn.T, robots[:, 2:4] @ turn.T
    return step._replace(states=robots.reshape(1, -1).astype(np.float32))


def meeting(offset: float, speed: float = 0.5, angle: float = 0.0, gap: float = 0.8) -> Sides:
    """How many oncoming robots robots 0 and 1 have on their right and left."""
    right, left = count_oncoming(meeting_step(offset, speed, angle, gap))
    assert (right[0, 2:] + left[0, 2:] == 0).all()
    return list(right[0, :2]), list(left[0, :2])


@pytest.mark.parametrize(("offset", "cost"), [(-0.2, 0.5), (0.2, 0.25)])
def test_each_side_has_its_cost(offset: float, cost: float) -> None:
    step = meeting_step(offset, 0.5, 0.0, 0.8)
    rewards = np.ones((1, 4), np.float32)
    changed = less_oncoming(rewards, step, step, 0.0, right=0.5, left=0.25)
    np.testing.assert_array_equal(changed, [[1 - cost, 1 - cost, 1, 1]])
    assert changed.dtype == np.float32


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_both_have_the_other_on_the_same_side(angle: float) -> None:
    assert meeting(-0.2, angle=angle) == ([1, 1], [0, 0])
    assert meeting(0.2, angle=angle) == ([0, 0], [1, 1])


def test_robots_that_stand_have_passed_or_are_far_away_do_not_meet() -> None:
    nobody: Sides = ([0, 0], [0, 0])
    assert meeting(-0.2, speed=0.05) == nobody
    assert meeting(-0.2, speed=-0.5) == nobody
    assert meeting(-0.2, gap=1.2) == nobody


@settings(deadline=None)
@given(st.floats(0, 1))
def test_shares_keep_the_teams_mean(share: float) -> None:
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    rewards = np.arange(8, dtype=np.float32).reshape(2, 4)
    mixed = with_team_share(rewards, step, step, 1.0, share=share, sides=TaskSpec().sides)
    assert mixed.dtype == np.float32
    np.testing.assert_allclose(mixed.mean(1), rewards.mean(1), rtol=1e-5)
    np.testing.assert_allclose(np.ptp(mixed, axis=1), (1 - share) * 3, atol=1e-5)
    mixed = with_team_share(
        rewards, step, step, 1.0, share=share, sides=[Side("a", range(3)), Side("b", range(3, 4))]
    )
    np.testing.assert_allclose(mixed[:, :3].mean(1), rewards[:, :3].mean(1), rtol=1e-5)
    np.testing.assert_allclose(mixed[:, 3], rewards[:, 3], rtol=1e-5)
