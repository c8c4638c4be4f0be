"""The preset `robotarium` keeps to the testbed's rules, here and in the testbed's own simulator.

That simulator is on no index, so its test is skipped unless it is installed: `pip install
git+https://github.com/robotarium/robotarium_python_simulator`.
"""

from typing import Any

import numpy as np
import pytest

from swarmdata.numerics.random import validation_seeds
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.types import Double, Float

DISC, OFFSET = 0.135, 0.025
"""m: diameter of a robot's collision disc, and how far ahead of its pose the disc's centre is."""

BASE, SPEED = 0.11, 0.2
"""m between the wheels, and m/s of each at most."""

SPEC = preset("robotarium")
ROBOT = SPEC.robots[0]


def least_distance(robots: Float) -> float:
    """Between the centres of two collision discs in states [T, N, 8], m."""
    centers = robots[..., [X, Y]] + OFFSET * robots[..., [UX, UY]]
    apart = np.linalg.norm(centers[:, :, None] - centers[:, None], axis=-1)
    return float((apart + 9.0 * np.eye(SPEC.n_agents)).min())


def wheel_speeds(actions: Float) -> Double:
    """Of commands, [..., 2] m/s."""
    v, w = ROBOT.max_speed * actions[..., 0], ROBOT.max_turn_rate * actions[..., 1]
    return np.stack([v - w * BASE / 2, v + w * BASE / 2], axis=-1)


def test_the_preset_has_the_testbeds_constants() -> None:
    assert pytest.approx(2 * ROBOT.max_speed / BASE, abs=1e-3) == ROBOT.max_turn_rate
    assert 0.999 * SPEED < ROBOT.max_speed < SPEED
    assert pytest.approx(DISC / 2 + OFFSET) == ROBOT.radius
    assert (SPEC.arena.width, SPEC.arena.height, SPEC.control_dt) == (3.2, 2.0, 0.033)


@pytest.mark.parametrize("n_episodes", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_the_scripted_team_keeps_to_the_rules(n_episodes: int) -> None:
    env = make_env(SPEC, n_episodes)
    for episode in rollout(env, make_policy("scripted", SPEC), validation_seeds(n_episodes)):
        robots = robots_of(episode.states, SPEC.n_agents)
        assert episode.success
        assert least_distance(robots) > DISC
        assert (np.abs(robots[..., [X, Y]]) < SPEC.half_size).all()
        assert np.abs(wheel_speeds(episode.actions)).max() < SPEED


@pytest.mark.slow
def test_the_testbeds_simulator_finds_no_violation() -> None:
    """The scripted team sees the poses of that simulator, and drives its robots."""
    rps = pytest.importorskip("rps.robotarium", reason="the testbed's simulator is absent")
    n, policy = SPEC.n_agents, make_policy("scripted", SPEC)
    for seed in validation_seeds(20):
        step = make_env(SPEC).reset(np.array([seed]))
        robots = robots_of(step.states, n)[0].astype(np.float64)
        headings = np.arctan2(robots[:, UY], robots[:, UX])
        there: Any = rps.Robotarium(
            number_of_robots=n,
            initial_conditions=np.stack([robots[:, X], robots[:, Y], headings]),
            sim_in_real_time=False,
            skip_initialization=True,
        )
        policy.reset(step, np.arange(1))
        for _ in range(SPEC.horizon):
            x, y, angles = there.get_poses()
            now = step.states.copy()
            seen = robots_of(now, n)[0]
            along = there._velocities[0]  # of the command before
            seen[:, [X, Y]] = np.stack([x, y], axis=-1)
            seen[:, [UX, UY]] = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
            seen[:, [VX, VY]] = along[:, None] * seen[:, [UX, UY]]
            step = step._replace(states=now)
            action = policy.act(step)[0].astype(np.float64)
            v, w = ROBOT.max_speed * action[:, 0], ROBOT.max_turn_rate * action[:, 1]
            there.set_velocities(np.arange(n), np.stack([v, w]))
            there.step()
            places = robots_of(step.states, n)[0]
            if (np.hypot(*(places[:, [X, Y]] - places[:, [TX, TY]]).T) < 0.1).all():
                break
        else:
            pytest.fail("the team is not at its goals")
        assert not there._errors
