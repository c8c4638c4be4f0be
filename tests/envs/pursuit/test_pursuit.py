"""Pursuit: starts, captures and sight, against an independent account of states."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.pursuit.pursuit import Pursuit
from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.numerics.sight import is_in_sight
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, Y, robots_of
from swarmdata.types import Float, Int, Seeds
from tests.envs.worlds import NO_OBSTACLES, rules_of
from tests.support.made_episodes import played

SPEC = preset("pursuit")


@pytest.mark.parametrize("name", ["pursuit", "pursuit-n6"])
def test_robots_start_in_one_corner_and_evaders_away_from_them(name: str) -> None:
    spec, n_copies = preset(name), 40
    task, rules = Pursuit(spec), spec.rules_as(PursuitRules)
    step = make_env(spec, n_copies).reset(np.arange(n_copies, dtype=np.uint64))
    half, c, corners = np.array(spec.half_size), task.columns, set()
    for state, layout in zip(step.states, step.layouts, strict=True):
        robots = robots_of(state, spec.n_agents)[:, : Y + 1].astype(np.float64)
        evaders = state[c.places : c.captured].reshape(-1, 2).astype(np.float64)
        (corner,) = {tuple(signs) for signs in np.sign(robots)}
        corners.add(corner)
        assert (np.abs(robots) >= half - rules.start_size - 1e-5).all()
        room = 0.1 + spec.spawn.goal_clearance - 1e-5
        assert all(clearance(*place, layout, half) >= room for place in evaders)
        gaps = np.linalg.norm(robots[:, None] - evaders, axis=-1)
        assert gaps.min() >= spec.spawn.min_goal_distance - 1e-5
        assert not state[c.captured : c.headings].any()
    assert len(corners) == 4


@pytest.mark.parametrize("policy", ["scripted", "random"])
@pytest.mark.parametrize("seed", [1, 2])
def test_evaders_keep_out_of_obstacles_and_to_their_speed(policy: str, seed: int) -> None:
    spec = preset("pursuit-n6")
    task, episode = Pursuit(spec), played(spec, seed, policy)
    c, half = task.columns, np.array(spec.half_size)
    places = episode.states[:, c.places : c.captured].reshape(-1, 2, 2).astype(np.float64)
    for evader in places.reshape(-1, 2):
        assert clearance(*evader, episode.layout, half) >= 0.1 - 1e-5
    moved = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    assert moved.max() <= 1.2 * 0.1 + 1e-6
    velocities = episode.states[1:, c.velocities : c.alarmed].reshape(-1, 2, 2)
    free = episode.states[1:, c.captured : c.velocities] == 0
    np.testing.assert_allclose(velocities[free], np.diff(places, axis=0)[free] / 0.1, atol=1e-5)


@pytest.mark.parametrize("name", ["pursuit-n6", "pursuit-sight"])
def test_captures_and_targets_are_those_of_the_docstring(name: str) -> None:
    spec = preset(name)
    rules, n = spec.rules_as(PursuitRules), spec.n_agents
    c, episode = Pursuit(spec).columns, played(spec)
    states = episode.states.astype(np.float64)
    robots = robots_of(episode.states, n).astype(np.float64)
    seen_at = np.full((n, c.n_evaders), -1000)
    last = np.zeros((n, c.n_evaders, 2))
    n_captures = 0
    for t, state in enumerate(states):
        evaders = state[c.places : c.captured].reshape(-1, 2)
        gaps = np.linalg.norm(robots[t, :, None, : Y + 1] - evaders, axis=-1)
        captured = state[c.captured : c.velocities]
        was = states[t - 1][c.captured : c.velocities] if t else np.zeros(c.n_evaders)
        if t:
            there = (gaps <= rules.capture_radius).sum(0) >= rules.captors
            np.testing.assert_array_equal(captured, there | (was > 0))
            before = states[t - 1][c.places : c.captured].reshape(-1, 2)
            np.testing.assert_array_equal(evaders[was > 0], before[was > 0])
        for i in range(n):
            for k in range(c.n_evaders):
                reach = np.inf if rules.sight_range is None else rules.sight_range
                if gaps[i, k] <= reach and (
                    np.isinf(reach)
                    or is_in_sight(*robots[t, i, : Y + 1], *evaders[k], episode.layout)
                ):
                    seen_at[i, k], last[i, k] = t, evaders[k]
        knows = (t - seen_at < 50) & ~((captured > 0) & (seen_at == t))
        for i in range(n):
            places = last[i][knows[i]]
            target = robots[t, i, : Y + 1]
            if len(places):
                target = places[np.linalg.norm(places - target, axis=-1).argmin()]
            np.testing.assert_allclose(robots[t, i, TX:], target, atol=1e-6)
        if t:
            n_captures += (captured - was).sum()
    assert n_captures == c.n_evaders
    assert episode.success
    assert episode.terminations[-1]


class Placed(Pursuit):
    """Robots and the only evader are where the test says."""

    places: Any = None

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        super().spawn(seeds, copies, layouts, states)
        robots_of(states, 3)[:, :, : Y + 1] = self.places[:3]
        states[:, self.columns.places : self.columns.captured] = self.places[3]


def test_two_robots_are_not_enough_and_three_capture_at_once() -> None:
    task = Placed(SPEC.with_updates(obstacles=NO_OBSTACLES))
    task.places = np.array([[-1.9, -1.5], [-1.5, -1.9], [0.0, 0.0], [-1.9, -1.9]])
    env = TaskEnv(task, 1, KinematicBackend)
    step = env.reset(np.zeros(1, np.uint64))
    towards = np.array([[[0.0, 0.0], [0.0, 0.0], [-0.7, -0.7]]])
    captured, count = task.columns.captured, 0
    while not step.terminations[0]:
        step = env.step(towards)
        robots, evader = (
            robots_of(step.states, 3)[0, :, :2],
            step.states[0, captured - 2 : captured],
        )
        near = (np.linalg.norm(robots - evader, axis=-1) <= 0.45).sum()
        assert near >= 2  # the corner holds it
        assert step.states[0, captured] == (near == 3)
        count += 1
    assert step.successes[0]
    assert count > 20
    w = SPEC.rules_as(PursuitRules).rewards
    np.testing.assert_allclose(step.reward_terms[0, :, 1], 1.0)
    assert (step.rewards >= w.capture).all()


def test_nothing_observed_depends_on_evaders_out_of_sight() -> None:
    """With limited sight and no messages, moving an evader that nobody knows changes nothing."""
    spec = preset("pursuit-sight").with_updates(communication="none")
    task, n_copies = Pursuit(spec), 20
    c = task.columns
    idle = np.zeros((n_copies, 3, 2))
    ids = np.arange(n_copies, dtype=np.uint64)

    class Elsewhere(Pursuit):
        def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
            super().spawn(seeds, copies, layouts, states)
            states[:, c.places : c.captured] *= 0.9

    envs = [TaskEnv(kind(spec), n_copies) for kind in (Pursuit, Elsewhere)]
    steps = [env.reset(ids) for env in envs]
    for _ in range(10):
        is_known = np.stack([step.states[:, c.memory :: 6].any(1) for step in steps]).any(0)
        assert not is_known.all()
        first, second = (step.observations[~is_known] for step in steps)
        np.testing.assert_array_equal(first, second)
        assert not np.array_equal(steps[0].states[:, c.places], steps[1].states[:, c.places])
        steps = [env.step(idle) for env in envs]


def test_what_a_robot_knows_is_observed() -> None:
    spec = rules_of(SPEC, evaders=2)
    env = make_env(spec, 3)
    names, task = [feature.name for feature in env.features], Pursuit(spec)
    step = env.reset(np.arange(3, dtype=np.uint64))
    idle, c = np.zeros((3, 3, 2)), task.columns
    for _ in range(3):
        step = env.step(idle)
    places = step.states[:, c.places : c.captured].reshape(3, 1, 2, 2)
    offsets = places - robots_of(step.states, 3)[:, :, None, :2]
    for k in range(2):
        first = names.index(f"evader_{k}.offset_x")
        seen = step.observations[..., first : first + 6]
        np.testing.assert_allclose(seen[..., :2], offsets[:, :, k], atol=1e-6)
        velocity = step.states[:, None, c.velocities + 2 * k :][..., :2]
        np.testing.assert_allclose(seen[..., 2:4], np.repeat(velocity, 3, 1), atol=1e-6)
        np.testing.assert_array_equal(seen[..., 4:], np.broadcast_to([0, 1], (3, 3, 2)))


def test_a_surrounded_evader_is_in_the_hull_of_the_robots_near_it() -> None:
    task, states = Pursuit(SPEC), np.zeros((4, 32), np.float32)
    robots = robots_of(states, 3)
    robots[:, :, :2] = [[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]]
    states[2, 8:10] = 0.5, 0.8  # all on one side
    states[3, 8:10] = -1.5, 0.8  # too far
    episode = played(SPEC.with_updates(horizon=3), 1, "idle")
    object.__setattr__(episode, "states", states)
    metrics = task.episode_metrics(episode)
    assert metrics == {"evaders_captured": 0.0, "time_surrounded": pytest.approx(1 / 3)}
    states[:, task.columns.captured] = 1.0
    assert task.episode_metrics(episode)["time_surrounded"] == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"captors": 4}, "captors is 4 in a team of 3 robots"),
        ({"capture_radius": 0.2}, r"capture_radius is 0.2 m, expected at least 0\.3"),
        ({"start_size": 5.0}, "start_size is 5 m in an arena of 4 m x 4 m"),
        ({"evader": "sly"}, "evader"),
    ],
)
def test_rules_that_cannot_be_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        Pursuit(rules_of(SPEC, **changes))


def test_without_room_no_episode_is_drawn() -> None:
    spec = SPEC.with_updates(spawn={"min_goal_distance": 6.0, "max_attempts": 3})
    with pytest.raises(SpawnError, match=r"evaders 6 m away. Use fewer or smaller"):
        make_env(spec, 1).reset(np.zeros(1, np.uint64))
