"""The warehouse: orders and metrics against an independent account of recorded states."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.warehouse.floor_plan import FloorPlan
from swarmdata.envs.warehouse.warehouse import ROBOT_EXTRAS, Warehouse
from swarmdata.errors import SpawnError
from swarmdata.numerics.random import STREAMS, derive, uniform
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.state_layout import N_COLUMNS, TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Episode, Float
from tests.envs.worlds import NO_OBSTACLES, seeds_of
from tests.support.made_episodes import cut, played
from tests.support.pairs import every, slow

PRESETS = [name for name in preset_names() if name.startswith("warehouse")]


def spec_of(n_agents: int = 4, robot: dict[str, Any] | None = None, **rules: Any) -> TaskSpec:
    team = [{"count": n_agents, "robot": robot or {}}]
    rules = {"task": "warehouse", **rules}
    return TaskSpec.parse({"rules": rules, "team": team, "horizon": 400, "obstacles": NO_OBSTACLES})


def own_of(states: Float, n_agents: int) -> Float:
    """The task's columns (carrying, deliveries), [..., N, 2]."""
    return states[..., N_COLUMNS * n_agents :].reshape(
        *states.shape[:-1], n_agents, len(ROBOT_EXTRAS)
    )


def drawn_target(plan: FloorPlan, seed: int, robot: int, order: int, carries: bool) -> Double:
    """The place or station of an order, from `seeding` alone."""
    bits = derive(seed, STREAMS["layout"], robot, order, int(carries))
    places = plan.places[plan.n_picks :] if carries else plan.places[: plan.n_picks]
    chosen: Double = places[int(uniform(bits)[0] * len(places))]
    return chosen


@pytest.mark.parametrize("name", every(3, PRESETS))
def test_robots_start_with_their_first_order(name: str) -> None:
    spec = preset(name)
    n = spec.n_agents
    task = Warehouse(spec)
    ids = np.arange(2**62, 2**62 + 100, dtype=np.uint64)
    step = make_env(spec, 100).reset(ids)
    for b, robots in enumerate(robots_of(step.states, n)):
        np.testing.assert_array_equal(step.layouts[b], task.plan.shelves)
        targets = [drawn_target(task.plan, int(ids[b]), i, 0, False) for i in range(n)]
        np.testing.assert_allclose(robots[:, TX:], targets, atol=1e-6)
    assert not own_of(step.states, n).any()


def test_more_robots_than_the_floor_holds_are_refused() -> None:
    spec = spec_of(60).with_updates(spawn={"max_attempts": 3})
    with pytest.raises(SpawnError, match="60 robots with their gaps do not fit"):
        make_env(spec, 1).reset(seeds_of(1))


def account(spec: TaskSpec, episode: Episode) -> Bool:
    """Whether solved [T], step by step from states; checks all states."""
    plan, n = FloorPlan.of(spec), spec.n_agents
    rules: Any = spec.rules
    robots, own = robots_of(episode.states, n).astype(np.float64), own_of(episode.states, n)
    solved = np.zeros(len(episode), dtype=np.bool_)
    for t in range(len(episode)):
        for i in range(n):
            away = robots[t + 1, i, : Y + 1] - robots[t, i, TX:]
            carries, order = bool(own[t, i, 0]), int(own[t, i, 1])
            if np.linalg.norm(away) <= rules.goal_radius:
                carries, order = not carries, order + carries
            assert own[t + 1, i].tolist() == [carries, order]
            expected = drawn_target(plan, episode.seed, i, order, carries)
            np.testing.assert_allclose(robots[t + 1, i, TX:], expected, atol=1e-6)
        solved[t] = own[t + 1, :, 1].sum() >= rules.quota
    return solved


@pytest.mark.parametrize("name", ["warehouse-hard", *slow("warehouse", "warehouse-easy")])
def test_orders_are_those_of_the_docstring(name: str) -> None:
    spec = preset(name)
    episode = played(spec)
    np.testing.assert_array_equal(account(spec, episode), episode.terminations)
    assert own_of(episode.states[-1], spec.n_agents)[:, 1].sum() >= 2


def test_features_tell_what_a_robot_carries_and_where_to_drive() -> None:
    spec = spec_of()
    env = make_env(spec, 1)
    names = [feature.name for feature in env.features]
    assert [names.count(name) for name in ("carrying", "corner_x", "corner_y")] == [1, 1, 1]
    columns = [names.index(name) for name in ("carrying", "corner_x", "corner_y")]
    episode = played(spec)
    seen = episode.observations[..., columns]
    np.testing.assert_array_equal(seen[..., 0], own_of(episode.states, 4)[..., 0])
    robots, middles = robots_of(episode.states, 4), FloorPlan.of(spec).middles
    to = robots[..., : Y + 1] + seen[..., 1:]
    at_target = np.isclose(to, robots[..., TX:], atol=1e-5).all(-1)
    at_crossing = np.isclose(np.abs(to[..., 0]), 1.65, atol=1e-5)
    at_crossing &= np.isclose(to[..., 1, None], middles, atol=1e-5).any(-1)
    assert (at_target ^ at_crossing).all()
    assert at_target.any()
    assert at_crossing.any()


def test_metrics_are_what_their_names_say() -> None:
    spec = spec_of(2)
    episode = played(spec_of(2), 4)
    steps = 61
    states = np.repeat(episode.states[:1], steps, axis=0)
    robots, own = robots_of(states, 2), own_of(states, 2)
    robots[:, :, : Y + 1] = [[0.0, -1.5], [0.4, -1.5]]  # side by side, for ever
    own[20:40, 0, 0] = 1.0
    own[40:, 0, 1] = 1.0
    own[:, 1, 1] = 2.0
    values = Warehouse(spec).episode_metrics(cut(episode, states))
    assert set(values) == set(Warehouse.metrics)
    assert values["deliveries"] == 3.0
    assert values["throughput"] == pytest.approx(3 / 2 / (6.0 / 60))
    assert values["deadlocks"] == 1.0
    assert values["carrying_time"] == pytest.approx(20 / 60 / 2)
