"""The intersection: trips and metrics, accounted for anew from recorded states."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.intersection.intersection import N_EXTRAS, START_JITTER, Intersection, StartPlan
from swarmdata.envs.intersection.junction import Junction, arm_at
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.numerics.random import STREAMS, derive, uniform
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, TX, Y, robots_of
from swarmdata.types import Float, Int, Seeds
from tests.envs.worlds import seeds_of
from tests.support.made_episodes import cut, played
from tests.support.pairs import slow


def own_of(states: Float, n_agents: int) -> Float:
    """The task's columns (crossing, crossings, wait), [..., N, 3]."""
    return states[..., N_COLUMNS * n_agents :].reshape(*states.shape[:-1], n_agents, N_EXTRAS)


def drawn(seed: int, robot: int, trip: int, which: int) -> float:
    """The uniform number of a trip's exit (0) or due time (1), from `random` alone."""
    return float(uniform(derive(seed, STREAMS["layout"], robot, trip, which))[0])


@pytest.mark.parametrize("name", ["intersection", *slow("intersection-n8")])
def test_trips_are_those_of_the_docstring(name: str) -> None:
    spec = preset(name).with_updates(horizon=200)
    episode, n, junction = played(spec), spec.n_agents, Junction.of(spec)
    robots, own = robots_of(episode.states, n).astype(np.float64), own_of(episode.states, n)
    r: Any = spec.rules
    n_entered = n_left = 0
    for t in range(len(episode)):
        for i in range(n):
            target, (x, y) = robots[t, i, TX:], robots[t + 1, i, : Y + 1]
            crosses, trip = bool(own[t, i, 0]), int(own[t, i, 1])
            arm = arm_at(*target)
            due = (trip + drawn(episode.seed, i, trip, 1)) * r.headway
            now = (t + 1) * spec.control_dt
            if np.hypot(*(target - (x, y))) <= r.goal_radius:
                if crosses:
                    crosses, trip, target = False, trip + 1, junction.entries[arm]
                    n_left += 1
                elif due <= now:
                    goal = (arm + 1 + int(3 * drawn(episode.seed, i, trip, 0))) % 4
                    crosses, target = True, junction.exits[goal]
                    n_entered += 1
            due = (trip + drawn(episode.seed, i, trip, 1)) * r.headway
            wait = 0.0 if crosses else max(due - now, 0.0)
            np.testing.assert_allclose(own[t + 1, i], [crosses, trip, wait], atol=1e-5)
            np.testing.assert_allclose(robots[t + 1, i, TX:], target, atol=1e-6)
    assert n_left >= 3
    assert n_entered >= n_left


def test_an_episode_is_solved_by_the_quota() -> None:
    spec = preset("intersection").with_updates(rules={"task": "intersection", "quota": 3})
    episode = played(spec)
    assert episode.success
    crossings = own_of(episode.states, 4)[..., 1].sum(-1)
    assert crossings[-1] >= 3
    assert (crossings[:-1] < 3).all()


class Placed(Intersection):
    """Robots start where the test says."""

    position = (0.0, 0.0)

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        super().spawn(seeds, copies, layouts, states)
        robots_of(states, 1)[:, 0, : Y + 1] = self.position


def test_a_robot_in_its_entry_waits_until_its_trip_is_due() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 1}])
    task, idle = Placed(spec), np.zeros((1, 1, 2))
    due = drawn(5, 0, 0, 1) * 6.0
    step = TaskEnv(Intersection(spec), 1).reset(seeds_of(5))
    arm = arm_at(*robots_of(step.states, 1)[0, 0, : Y + 1])
    task.position = tuple(task.junction.entries[arm])
    env = TaskEnv(task, 1, KinematicBackend)
    step = env.reset(seeds_of(5))
    names = [feature.name for feature in env.features]
    n_waited = 0
    while not own_of(step.states, 1)[0, 0, 0]:
        wait = own_of(step.states, 1)[0, 0, 2]
        assert wait == pytest.approx(max(due - n_waited * 0.1, 0.0), abs=1e-5)
        assert step.observations[0, 0, names.index("wait")] == pytest.approx(wait / 6.0, abs=1e-5)
        step, n_waited = env.step(idle), n_waited + 1
    assert n_waited * 0.1 == pytest.approx(due, abs=0.1)
    assert step.observations[0, 0, names.index("crossing")] == 1.0
    assert own_of(step.states, 1)[0, 0].tolist() == [1.0, 0.0, 0.0]


def test_metrics_are_what_their_names_say() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 2}])
    episode = played(spec)
    states = np.repeat(episode.states[:1], 61, axis=0)
    robots, own = robots_of(states, 2), own_of(states, 2)
    robots[:, :, : Y + 1] = [[0.0, -1.5], [0.4, -1.5]]  # side by side, for ever
    robots[:, :, 2:4] = 0.0
    own[:, :, 2] = 0.0
    own[:, 0, 1] = 3.0
    values = Intersection(spec).episode_metrics(cut(episode, states))
    assert set(values) == set(Intersection.metrics)
    assert values["crossings"] == 3.0
    assert values["throughput"] == pytest.approx(3 / (6.0 / 60))
    assert values["waiting_time"] == pytest.approx(6.0)
    assert values["deadlocks"] == 1.0
    own[:, 1, 2] = 1.0  # its trip is not due
    values = Intersection(spec).episode_metrics(cut(episode, states))
    assert values["waiting_time"] == pytest.approx(3.0)
    assert values["deadlocks"] == 0.0


IDS = np.arange(2**62, 2**62 + 100, dtype=np.uint64)


@pytest.mark.parametrize(("name", "n"), [("intersection", 4), ("intersection-n8", 8)])
def test_robots_start_clear_of_all_and_as_many_in_each_arm(name: str, n: int) -> None:
    spec = preset(name)
    task = Intersection(spec)
    states = np.ones((100, N_COLUMNS * n + 3 * n), np.float32)
    task.spawn(IDS, np.arange(100), np.zeros((100, 4, 8), np.float32), states)
    half, first_arms = np.array(spec.half_size), set()
    for robots in robots_of(states, n).astype(np.float64):
        arms = [arm_at(*robot[: Y + 1]) for robot in robots]
        assert np.bincount(arms, minlength=4).tolist() == [n // 4] * 4
        first_arms.add(arms[0])
        apart = np.linalg.norm(robots[:, None, : Y + 1] - robots[:, : Y + 1], axis=-1)
        assert (apart[~np.eye(n, dtype=bool)] >= 2 * 0.12 + 0.05).all()
        assert all(clearance(*r[: Y + 1], task.junction.corners, half) >= 0.13 for r in robots)
        assert not robots[:, 2:4].any()
    assert first_arms == {0, 1, 2, 3}


def test_the_first_robot_of_an_arm_is_in_its_entry_and_the_third_behind_its_exit() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 9}])
    junction = Junction.of(spec)
    plan = StartPlan.of(spec, junction)
    assert plan.places.shape == (4, 3, 2)
    np.testing.assert_allclose(plan.places[:, 0], junction.entries)
    np.testing.assert_allclose(plan.places[:, 1], junction.exits)
    behind = np.linalg.norm(junction.exits - plan.places[:, 2], axis=-1)
    np.testing.assert_allclose(behind, 0.24 + spec.spawn.start_separation + 2 * START_JITTER)


def test_more_robots_than_the_arms_hold_are_refused() -> None:
    spec = preset("intersection").with_updates(team=[{"count": 24}])
    with pytest.raises(SpecError, match=r"6 robots with gaps of 0\.21 m do not fit in an arm"):
        Intersection(spec)
