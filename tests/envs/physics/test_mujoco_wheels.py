"""Robots on wheels: they drive as the planar unicycle does, by wheels, torques and friction."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

from swarmdata.envs.physics.mujoco_wheels import WHEEL_RADIUS
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double, Float
from tests.envs.physics.scenes import NOTHING, Numbers, Scene

WHEELS = {"dynamics": "unicycle", "base": "wheels"}
SPEED, ACCELERATION, TURN_RATE, RADIUS = 0.6, 1.5, 3.0, 0.12


def scene_of(robots: Sequence[dict[str, Any]], rows: Numbers, layout: Float = NOTHING) -> Scene:
    """Robots in an arena with walls alone, or with obstacles."""
    return Scene(robots, rows, "mujoco", layout=layout)


def driven(
    robots: Any, rows: Numbers, commands: Numbers, n: int, layout: Float = NOTHING
) -> Double:
    """The robots while they keep to commands for n steps, [n, N, 8]."""
    return scene_of(robots, rows, layout).drive(commands, n)[0]


def aside(rows: Double) -> Double:
    """Sideways speeds of robots [..., 8]."""
    return rows[..., 3] * rows[..., 4] - rows[..., 2] * rows[..., 5]


def test_it_reaches_its_speed_with_the_acceleration_of_its_motors() -> None:
    rows = driven([WHEELS], [(0, 0, 0, 0)], [(1, 0)], 12)[:, 0]
    np.testing.assert_allclose(rows[1, 2], 0.2 * ACCELERATION, rtol=0.08)
    np.testing.assert_allclose(rows[-1, 2], SPEED, rtol=0.01)
    np.testing.assert_allclose(rows[:, [1, 3, 5]], 0.0, atol=1e-6)


def test_it_starts_with_any_heading_and_velocity() -> None:
    u = np.array([np.cos(2.0), np.sin(2.0)])
    row = driven([WHEELS], [(0.1, -0.2, *(SPEED * u), *u)], [(1, 0)], 1)[0, 0]
    np.testing.assert_allclose(row[:2], [0.1, -0.2] + 0.1 * SPEED * u, atol=2e-3)
    np.testing.assert_allclose(row[2:4], SPEED * u, atol=0.01)
    np.testing.assert_allclose(row[4:6], u, atol=1e-3)


def test_a_turn_takes_a_moment_and_reaches_its_rate() -> None:
    rows = driven([WHEELS], [(0, 0, 0, 0)], [(0, 1)], 10)[:, 0]
    angles = np.unwrap(np.arctan2(rows[:, 5], rows[:, 4]))
    rates = np.diff(angles, prepend=0.0) / 0.1
    assert 0.2 < rates[0] / TURN_RATE < 0.7
    np.testing.assert_allclose(rates[-1], TURN_RATE, rtol=0.03)
    assert np.hypot(rows[:, 0], rows[:, 1]).max() < 0.02, "it turns on the spot"


def test_a_heavy_robot_accelerates_less_and_one_without_grip_slips() -> None:
    speeds = [
        driven([{**WHEELS, "mass": mass}], [(0, 0, 0, 0)], [(1, 0)], 2)[-1, 0, 2]
        for mass in (1.0, 2.0, 5.0)
    ]
    np.testing.assert_allclose(speeds, 0.3 / np.array([1.0, 2.0, 5.0]), rtol=0.1)
    turns, starts = [], []
    for grip in (10.0, 1.0, 0.3):
        robot = {**WHEELS, "wheel_grip": grip}
        turns.append(abs(aside(driven([robot], [(0, 0, SPEED, 0)], [(1, 1)], 4)[-1, 0])))
        starts.append(driven([robot], [(0, 0, 0, 0)], [(1, 0)], 2)[-1, 0, 2])
    assert turns[0] < 0.04 < 0.08 < turns[1] < turns[2]  # noqa: PLR0133  (a chain of bounds)
    np.testing.assert_allclose(starts, [0.29, 0.2, 0.06], rtol=0.1)


def test_a_blocked_robot_pushes_no_harder_than_its_motors() -> None:
    """Two robots that push each other stand still, and one of more force wins."""
    scene = scene_of([WHEELS, WHEELS], [(-0.14, 0, 0, 0, 1, 0), (0.14, 0, 0, 0, -1, 0)])
    rows, _ = scene.drive([(1, 0), (1, 0)], 20)
    np.testing.assert_allclose(rows[-1, :, 2], 0.0, atol=0.01)
    assert scene.events[0, :, 2].tolist() == [1, 1]
    gaps = np.hypot(*(rows[:, 1, :2] - rows[:, 0, :2]).T) - 2 * RADIUS
    assert gaps.min() > -0.01
    strong = {**WHEELS, "max_acceleration": 2 * ACCELERATION}
    scene = scene_of([strong, WHEELS], [(-0.14, 0, 0, 0, 1, 0), (0.14, 0, 0, 0, -1, 0)])
    assert scene.drive([(1, 0), (1, 0)], 20)[0][-1, 1, 0] > 0.2


def test_wheels_hold_where_a_planar_robot_slides_round_an_obstacle() -> None:
    """Why driving straight at the goal solves less on wheels: tyres do not slip sideways."""
    disc, angle = np.array([[0, 0, 0, 1, 0, 0.2, 0.2, 0]], np.float32), np.radians(30.0)
    x, y = (0.205 + RADIUS) * np.array([-np.cos(angle), np.sin(angle)])
    found = {}
    for name, robot in (("wheels", WHEELS), ("planar", {"dynamics": "unicycle"})):
        rows = driven([robot], [(x, y, 0, 0)], [(1, 0)], 60, disc)
        found[name] = rows[-1, 0, :2] - rows[9, 0, :2]
    assert np.hypot(*found["wheels"]) < 0.01
    assert found["planar"][0] > 1.0


def test_a_push_turns_it_and_planar_robots_may_be_in_its_team() -> None:
    scene = scene_of([WHEELS, {}], [(0, 0, 0, 0), (-0.4, 0.08, SPEED, 0)])
    rows, _ = scene.drive([(0, 0), (1, 0)], 12)
    assert scene.events[0, :, 2].tolist() == [1, 1]
    assert rows[-1, 0, 0] > 0.03, "it was pushed"
    assert rows[-1, 1, 4:6].tolist() == [1.0, 0.0], "a planar heading is a command"


def test_it_stands_on_the_floor() -> None:
    scene = scene_of([WHEELS, {}], [(0, 0, 0, 0), (1, 1, 0, 0)])
    scene.drive([(0.5, 0.5), (0, 0)], 10)
    copy = scene.backend._copies[0]
    assert copy is not None
    assert abs(copy.coordinates.positions[2]) < 0.01 * WHEEL_RADIUS, "it sinks in"
    assert copy.data.ncon == 3, "two wheels and a caster"


def test_scripted_unicycles_act_unchanged_on_wheels() -> None:
    wheeled, planar = preset("coop_nav-wheeled"), preset("coop_nav-unicycle")
    seeds = np.arange(4, dtype=np.uint64)
    env, policy = make_env(wheeled, 4), make_policy("scripted", wheeled)
    step = env.reset(seeds)
    starts = make_env(planar, 4).reset(seeds)
    np.testing.assert_array_equal(step.states, starts.states)
    np.testing.assert_array_equal(step.observations, starts.observations)
    policy.reset(step, np.arange(4))
    solved = np.zeros(4, np.bool_)
    for _ in range(wheeled.horizon):
        step = env.step(policy.act(step))
        solved |= step.successes
    assert solved.sum() >= 3


def test_wheels_need_a_unicycle_and_a_floor() -> None:
    with pytest.raises(SpecError, match="cannot move in any direction"):
        Robot.parse({"base": "wheels"})
    with pytest.raises(SpecError, match=r"base wheels needs backend mujoco, got pymunk"):
        TaskSpec.parse({"team": [{"robot": WHEELS}]})
