"""The rules of cooperative navigation: success, targets, features, metrics."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav.coop_nav import CoopNav
from swarmdata.errors import SpawnError, SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Seeds, Step

UNASSIGNED = {"task": "coop_nav", "goals": "unassigned"}


def spec_of(n: int, **changes: Any) -> TaskSpec:
    return preset("coop_nav").with_updates(team=[{"count": n}], **changes)


def seeds(first: int, n: int) -> Seeds:
    return np.arange(first, first + n, dtype=np.uint64)


def moved(step: Step, n: int, seed: int) -> Step:
    """The same step with robots at random places."""
    rng = np.random.default_rng(seed)
    states = step.states.copy()
    robots = robots_of(states, n)
    robots[..., [X, Y]] = rng.uniform(-1.9, 1.9, robots[..., [X, Y]].shape)
    return step._replace(states=states, times=step.times + 1)


def update(task: CoopNav, before: Step, now: Step) -> Bool:
    """Whether the task is solved, [E]; targets in `now` are written."""
    n_copies = len(before.seeds)
    terms: Float = np.full((n_copies, task.spec.n_agents, len(task.terms)), np.nan, np.float32)
    solved: Bool = np.zeros(n_copies, dtype=np.bool_)
    active: Bool = np.ones(n_copies, dtype=np.bool_)
    task.update(before, now._replace(reward_terms=terms), active, solved)
    return solved


def goals_of(state: Float, n: int) -> Double:
    return state[N_COLUMNS * n :].reshape(n, 2).astype(np.float64)


def places_of(state: Float, n: int) -> Double:
    return robots_of(state, n)[:, [X, Y]].astype(np.float64)


def distances(state: Float, n: int) -> Double:
    """Robots (rows) to unassigned goals (columns), m."""
    offsets = goals_of(state, n)[None] - places_of(state, n)[:, None]
    return np.linalg.norm(offsets, axis=-1)


def test_success_needs_all_robots_at_their_goals_at_once() -> None:
    spec = spec_of(2)
    task, before = CoopNav(spec), make_env(spec, 1).reset(seeds(3, 1))
    states = before.states.copy()
    robots = robots_of(states[0], 2)
    robots[:, [X, Y]] = robots[:, [TX, TY]]
    assert update(task, before, before._replace(states=states))[0]
    robots[1, X] += 0.16
    assert not update(task, before, before._replace(states=states))[0]


def test_unassigned_goals_may_be_covered_by_anyone_but_each_by_its_own() -> None:
    spec = spec_of(3, rules=UNASSIGNED)
    task, before = CoopNav(spec), make_env(spec, 1).reset(seeds(3, 1))
    states = before.states.copy()
    robots, goals = robots_of(states[0], 3), goals_of(states[0], 3)
    robots[:, [X, Y]] = goals[[2, 0, 1]]
    now = before._replace(states=states)
    assert update(task, before, now)[0]
    np.testing.assert_allclose(robots[:, [TX, TY]], goals[[2, 0, 1]])
    robots[1, [X, Y]] = goals[2] + [0.05, 0.0]  # a second robot at goal 2, none at goal 0
    assert not update(task, before, now)[0]
    np.testing.assert_allclose(robots[1, [TX, TY]], goals[0])  # goal 2 is robot 0's


@given(n=st.integers(1, 6), seed=st.integers(0, 2**32))
def test_targets_and_features_equal_their_numpy_twins(n: int, seed: int) -> None:
    spec = spec_of(n, rules=UNASSIGNED)
    task, before = CoopNav(spec), make_env(spec, 1).reset(seeds(seed, 1))
    now = moved(before, n, seed)
    if seed % 2:  # let a robot cover a goal
        robots_of(now.states[0], n)[seed % n, [X, Y]] = goals_of(now.states[0], n)[0] + 0.05
    update(task, before, now)
    out: Float = np.full((1, n, 3 * n), np.nan, dtype=np.float32)
    active: Bool = np.ones(1, dtype=np.bool_)
    task.write_features(now.states, now.layouts, active, out)
    state = now.states[0]
    d, goals = distances(state, n), goals_of(state, n)
    holder = [next((i for i in range(n) if d[i, k] <= 0.15), -1) for k in range(n)]
    for i in range(n):
        mine = [k for k in range(n) if holder[k] in (-1, i)]
        target = min(mine, key=lambda k: (d[i, k], k))
        np.testing.assert_array_equal(robots_of(state, n)[i, [TX, TY]], goals[target])
        for slot, k in enumerate(sorted(range(n), key=lambda k: (d[i, k], k))):
            seen = out[0, i, 3 * slot : 3 * slot + 3]
            np.testing.assert_allclose(seen[:2], goals[k] - places_of(state, n)[i], atol=1e-6)
            assert seen[2] == (holder[k] not in (-1, i))


def test_the_observation_ends_with_all_goals() -> None:
    assigned, shared = make_env(spec_of(4)), make_env(spec_of(4, rules=UNASSIGNED))
    assert shared.observation_size == assigned.observation_size + 12
    assert [f.name for f in shared.features[-3:]] == [
        "goal_3.offset_x",
        "goal_3.offset_y",
        "goal_3.is_taken",
    ]
    step = shared.reset(seeds(5, 1))
    gaps = np.linalg.norm(step.observations[0, :, -12:].reshape(4, 4, 3)[..., :2], axis=-1)
    np.testing.assert_allclose(gaps, np.sort(distances(step.states[0], 4), axis=1), atol=1e-6)


@pytest.mark.parametrize("goals", ["assigned", "unassigned"])
def test_reached_fraction_counts_goals_in_the_last_state(goals: str) -> None:
    spec = spec_of(4, rules={"task": "coop_nav", "goals": goals}, horizon=3)
    env = make_env(spec, 1)
    episode = next(iter(rollout(env, make_policy("idle", spec), seeds(1, 1))))
    states = episode.states.copy()
    robots = robots_of(states[-1], 4)
    places = goals_of(states[-1], 4) if goals == "unassigned" else robots[:, [TX, TY]].copy()
    robots[:, [X, Y]] = 5.0
    robots[1, [X, Y]] = places[1] + [0.1, 0.0]
    robots[2, [X, Y]] = places[2] + [0.0, 0.16]
    assert episode_metrics(replace(episode, states=states), env.task)["reached_fraction"] == 0.25


def test_unassigned_goals_that_one_robot_could_cover_are_refused() -> None:
    with pytest.raises(SpecError, match=r"unassigned goals can be 0\.440 m apart"):
        CoopNav(
            spec_of(4, rules={**UNASSIGNED, "goal_radius": 0.22}, spawn={"goal_separation": 0.2})
        )


def test_an_impossible_layout_raises_with_the_density() -> None:
    spec = TaskSpec.parse({"obstacles": {"pockets": 12}, "spawn": {"max_attempts": 5}})
    with pytest.raises(SpawnError, match=r"cover .*% of the arena"):
        make_env(spec).reset(seeds(1, 1))
