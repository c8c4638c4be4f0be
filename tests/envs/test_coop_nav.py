"""Cooperative navigation: its rules, and that an episode is one pure function of its seed."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav import PROXIMITY, TERMS, CoopNav
from swarmdata.envs.pymunk_space import PublicBackend
from swarmdata.errors import SchemaError, SpawnError, SpecError
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, Float, Seeds, Step


def toward_goals(step: Step) -> Double:
    """Commands that mix driving at the goal and noise from the state's own bits: many contacts."""
    rows = step.states.reshape(*step.rewards.shape, 6).astype(np.float64)
    wobble = rows[..., :2] * 1e3 % 1.0 - 0.5
    return 3.0 * (rows[..., 4:] - rows[..., :2]) + wobble


def play(env: CoopNav, seeds: Seeds, n_steps: int) -> list[Step]:
    steps = [env.reset(seeds)]
    for _ in range(n_steps):
        steps.append(env.step(toward_goals(steps[-1])))
    return steps


def assert_same(left: list[Step], right: list[Step], copy_left: int, copy_right: int) -> None:
    for a, b in zip(left, right, strict=True):
        for name in Step._fields:
            np.testing.assert_array_equal(
                getattr(a, name)[copy_left], getattr(b, name)[copy_right], err_msg=name
            )


def seeds(*values: int) -> Seeds:
    return np.array(values, dtype=np.uint64)


def test_an_episode_is_the_same_alone_in_a_batch_and_after_other_episodes() -> None:
    spec = TaskSpec()
    alone = play(CoopNav(spec, 1), seeds(7), 120)
    batch = play(CoopNav(spec, 5), seeds(3, 4, 7, 5, 6), 120)
    used = CoopNav(spec, 3)
    play(used, seeds(20, 21, 22), 61)
    assert_same(alone, batch, 0, 2)
    assert_same(alone, play(used, seeds(1, 7, 2), 120), 0, 1)
    assert alone[-1].events.any() or any(step.events.any() for step in alone)


def test_a_partial_reset_leaves_the_other_copies_alone() -> None:
    env = CoopNav(TaskSpec(), 3)
    before = play(env, seeds(1, 2, 3), 30)[-1]
    after = env.reset(seeds(9), np.array([1]))
    for name in Step._fields:
        for copy in (0, 2):
            np.testing.assert_array_equal(getattr(before, name)[copy], getattr(after, name)[copy])
    assert after.seeds[1] == 9
    assert after.times[1] == 0
    np.testing.assert_array_equal(after.states[1], CoopNav(TaskSpec(), 1).reset(seeds(9)).states[0])


def test_the_public_backend_gives_the_same_bits_through_resets() -> None:
    fast, public = CoopNav(TaskSpec(), 4), CoopNav(TaskSpec(), 4)
    public._world.backend = PublicBackend(public.spec, 4)
    for start in (0, 4, 8):
        ids = np.arange(start, start + 4, dtype=np.uint64)
        left, right = play(fast, ids, 100), play(public, ids, 100)
        for copy in range(4):
            assert_same(left, right, copy, copy)
        np.testing.assert_array_equal(
            fast._world.backend.positions, public._world.backend.positions
        )


def test_earlier_steps_are_never_written_to_again() -> None:
    env = CoopNav(TaskSpec(), 2)
    step = env.reset(seeds(1, 2))
    kept = [array.copy() for array in step]
    env.step(toward_goals(step))
    env.reset(seeds(5, 6))
    for array, copy in zip(step, kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_an_ended_copy_stays_put_without_reward() -> None:
    spec = TaskSpec(horizon=5)
    steps = play(CoopNav(spec, 2), seeds(1, 2), 8)
    assert steps[5].truncations.all()
    assert not steps[5].terminations.any()
    np.testing.assert_array_equal(steps[5].states, steps[8].states)
    np.testing.assert_array_equal(steps[8].times, [5, 5])
    assert not steps[8].rewards.any()
    assert steps[8].truncations.all()


def put(env: CoopNav, positions: Any) -> None:
    """Teleports the robots of copy 0, through the backend that allows it."""
    backend = env._world.backend
    layout, starts = env._world.layouts, np.array(backend.positions)
    starts[0] = positions
    env._world.reset(np.array([0]), starts)
    assert layout is env._world.layouts
    now = env._now
    assert now is not None
    now.states.reshape(-1, 6)[:, :2] = positions


@pytest.fixture
def open_spec() -> TaskSpec:
    nothing = {"circles": 0, "boxes": 0, "corners": 0, "pockets": 0}
    return TaskSpec.parse({"obstacles": nothing, "team": [{"count": 2}]})


def test_success_needs_all_robots_at_their_goals_at_once(open_spec: TaskSpec) -> None:
    env = CoopNav(open_spec, 1)
    goals = env.reset(seeds(3)).states.reshape(2, 6)[:, 4:].astype(np.float64)
    put(env, [goals[0], goals[1] + [0.2, 0.0]])
    step = env.step(np.zeros((1, 2, 2)))
    assert not step.terminations[0]
    put(env, goals)
    step = env.step(np.zeros((1, 2, 2)))
    assert step.terminations[0]
    assert step.successes[0]
    assert not step.truncations[0]
    weights = open_spec.rules.rewards
    np.testing.assert_allclose(step.rewards[0], weights.success, atol=1e-5)


def test_a_pair_collision_is_one_onset_until_the_robots_separate(open_spec: TaskSpec) -> None:
    env = CoopNav(open_spec, 1)
    env.reset(seeds(3))
    put(env, [(-0.15, 0.0), (0.15, 0.0)])
    commands = [1.0] * 8 + [-1.0] * 8 + [1.0] * 20
    events = [env.step(np.array([[[c, 0.0], [-c, 0.0]]])).events[0] for c in commands]
    onsets = np.array(events)[:, :, 2].sum(0)
    np.testing.assert_array_equal(onsets, [2, 2])
    assert np.array(events)[:, :, 0].sum() > 4
    assert not np.array(events)[:, :, [1, 3]].any()


def test_a_wall_is_an_obstacle_and_holds(open_spec: TaskSpec) -> None:
    env = CoopNav(open_spec, 1)
    env.reset(seeds(3))
    put(env, [(1.7, 0.0), (-1.0, 0.0)])
    for _ in range(20):
        step = env.step(np.array([[[1.0, 0.0], [0.0, 0.0]]]))
    assert step.events[0, 0, 1] == 1
    assert abs(step.states[0, 0] - (2.0 - 0.12)) < 0.01


def test_on_collision_fail_terminates_without_success(open_spec: TaskSpec) -> None:
    spec = open_spec.with_updates(on_collision="fail")
    env = CoopNav(spec, 1)
    env.reset(seeds(3))
    put(env, [(-0.13, 0.0), (0.13, 0.0)])
    for _ in range(4):
        step = env.step(np.array([[[1.0, 0.0], [-1.0, 0.0]]]))
    assert step.terminations[0]
    assert not step.successes[0]


def reference_rewards(spec: TaskSpec, before: Float, after: Step, gaps: Double) -> Double:
    """The docstring's formula, in NumPy."""
    w, n = spec.rules.rewards, spec.n_agents
    old = before.reshape(-1, n, 6).astype(np.float64)
    new = after.states.reshape(-1, n, 6).astype(np.float64)
    old_d = np.linalg.norm(old[..., 4:] - old[..., :2], axis=-1)
    new_d = np.linalg.norm(new[..., 4:] - new[..., :2], axis=-1)
    outside = new_d > spec.rules.goal_radius
    own = (
        w.progress * (old_d - new_d)
        - w.time * outside
        + w.success * ~outside.any(-1, keepdims=True)
        - w.robot_contact * after.events[..., 0]
        - w.obstacle_contact * after.events[..., 1]
        - w.robot_collision * after.events[..., 2]
        - w.obstacle_collision * after.events[..., 3]
        - w.proximity * np.clip(1 - gaps / PROXIMITY, 0, 1)
    )
    return (1 - w.team_share) * own + w.team_share * own.mean(-1, keepdims=True)


@given(share=st.sampled_from([0.0, 0.3, 1.0]), seed=st.integers(0, 2**32))
def test_rewards_follow_the_documented_formula(share: float, seed: int) -> None:
    env = CoopNav(TaskSpec.parse({"rules": {"task": "coop_nav", "rewards": {"team_share": share}}), 4)
    step = env.reset(np.arange(seed, seed + 4, dtype=np.uint64))
    for _ in range(40):
        before, step = step, env.step(toward_goals(step))
        expected = reference_rewards(env.spec, before.states, step, env._gaps)
        active = ~before.ended
        np.testing.assert_allclose(step.rewards[active], expected[active], atol=2e-6)


def test_reward_terms_are_all_weights_of_the_spec() -> None:
    assert set(TERMS) == set(type(TaskSpec().rewards).model_fields) - {"team_share"}


@pytest.mark.parametrize("command", ["velocity", "acceleration"])
def test_speed_and_acceleration_limits_hold(open_spec: TaskSpec, command: str) -> None:
    team = [{"count": 2, "robot": {"command": command}}]
    env = CoopNav(open_spec.with_updates(team=team), 1)
    step = env.reset(seeds(11))
    rng = np.random.default_rng(0)
    for _ in range(60):
        before = step.states.reshape(2, 6)[:, 2:4]
        step = env.step(rng.uniform(-2, 2, (1, 2, 2)))
        velocity = step.states.reshape(2, 6)[:, 2:4]
        if step.events.any():
            continue
        assert np.linalg.norm(velocity, axis=-1).max() <= 0.6 + 1e-5
        assert np.linalg.norm(velocity - before, axis=-1).max() <= 1.5 * 0.1 + 1e-5


def test_wrong_use_gives_one_clear_error() -> None:
    env = CoopNav(TaskSpec(), 2)
    with pytest.raises(SchemaError, match="before the first reset"):
        env.step(np.zeros((2, 4, 2)))
    with pytest.raises(SchemaError, match="one per reset copy"):
        env.reset(seeds(1))
    env.reset(seeds(1, 2))
    with pytest.raises(SchemaError, match=r"expected \(2, 4, 2\)"):
        env.step(np.zeros((2, 4)))
    with pytest.raises(SchemaError, match="NaN or infinite"):
        env.step(np.full((2, 4, 2), np.nan))


def test_an_impossible_layout_raises_with_the_density() -> None:
    spec = TaskSpec.parse({"obstacles": {"pockets": 12}, "spawn": {"max_attempts": 5}})
    with pytest.raises(SpawnError, match=r"cover .*% of the arena"):
        CoopNav(spec, 1).reset(seeds(1))


@pytest.mark.parametrize(
    "change",
    [
        {"observation": {"kind": "lidar"}},
        {"communication": {"kind": "broadcast"}},
        {"team": [{"robot": {"dynamics": "unicycle"}}]},
    ],
)
def test_what_cannot_be_run_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match="cannot be run"):
        CoopNav(TaskSpec.parse(change))
