"""Bodies: what mass, friction and grip change, in every simulator that has them."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env
from swarmdata.specs.state_layout import UX, UY, VX, VY
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double
from tests.envs.physics.scenes import Numbers, Scene
from tests.envs.worlds import NO_OBSTACLES

SIMULATORS = ("pymunk", "public", "mujoco", "kinematic")
WITH_CONTACTS = SIMULATORS[:3]
ACROSS = 0.5**0.5


def drive(
    backend: str, robots: Sequence[dict[str, Any]], rows: Numbers, commands: Numbers, n_steps: int
) -> Double:
    """The robots of an empty arena while they keep to commands, [n_steps, N, 8]."""
    return Scene(robots, rows, backend).drive(commands, n_steps)[0]


def test_usual_bodies_are_not_written() -> None:
    assert set(Robot.later_fields).isdisjoint(json.loads(Robot().to_json()))
    heavy = Robot(dynamics="unicycle", mass=2.0, friction=0.0, wheel_grip=1.0)
    assert Robot.from_text(heavy.to_yaml()) == heavy


@pytest.mark.parametrize("backend", SIMULATORS)
@pytest.mark.parametrize("command", ["velocity", "acceleration"])
@pytest.mark.parametrize("dynamics", ["holonomic", "unicycle"])
def test_the_same_motors_accelerate_a_heavy_robot_less(
    backend: str, command: str, dynamics: str
) -> None:
    team = [{"mass": m, "command": command, "dynamics": dynamics} for m in (1.0, 2.0, 5.0)]
    rows = [(0.0, y, 0.0, 0.0) for y in (-1.0, 0.0, 1.0)]
    speeds = drive(backend, team, rows, [(1.0, 0.0)] * 3, 2)[-1, :, 2]
    np.testing.assert_allclose(speeds, 1.5 * 0.2 / np.array([1.0, 2.0, 5.0]), rtol=1e-5)


@pytest.mark.parametrize("backend", WITH_CONTACTS)
def test_a_heavy_robot_is_hardly_stopped_by_a_light_one(backend: str) -> None:
    """Plastic impact: v = m u / (m + 1) (Newton), while nobody is driven."""
    rows = [(-0.16, 0.0, 0.6, 0.0), (0.1, 0.0, 0.0, 0.0)]
    for mass in (1.0, 4.0):
        robots: list[dict[str, Any]] = [
            {"mass": mass, "command": "acceleration"}, {"command": "acceleration"}
        ]  # fmt: skip
        speeds = drive(backend, robots, rows, [(0.0, 0.0)] * 2, 4)[-1, :, 2]
        np.testing.assert_allclose(speeds @ [mass, 1.0], 0.6 * mass, rtol=0.01)
        np.testing.assert_allclose(speeds[0], 0.6 * mass / (mass + 1.0), rtol=0.1)


@pytest.mark.parametrize("backend", WITH_CONTACTS)
def test_friction_brakes_what_slides_along_a_wall(backend: str) -> None:
    """Coulomb: the acceleration along the wall is less by 0.2 f times that into it."""
    ways = []
    for friction in (0.0, 0.2, 2.0):
        robot = {"friction": friction, "command": "acceleration", "max_speed": 2.0}
        rows = drive(backend, [robot], [(1.88, -1.0, 0.0, 0.0)], [(ACROSS, ACROSS)], 6)
        ways.append(rows[-1, 0, 3])
    expected = 1.5 * ACROSS * 0.6 * (1.0 - 0.2 * np.array([0.0, 0.2, 2.0]))
    np.testing.assert_allclose(ways, expected, rtol=0.12 if backend == "mujoco" else 0.06)


@pytest.mark.parametrize("backend", WITH_CONTACTS)
def test_friction_between_robots_is_the_product_of_theirs(backend: str) -> None:
    """A robot that slides along another one takes it along, the more, the rougher both are."""
    pulls = []
    for friction in (0.0, 0.5, 1.0):
        rough = {"friction": friction, "command": "acceleration", "max_speed": 5.0, "radius": 0.3}
        wall = {**rough, "mass": 1e4}
        rows = drive(
            backend, [rough, wall], [(0.0, 0.6, 0.5, 0.0), (0.0, 0.0, 0.0, 0.0)],
            [(0.0, -1.0), (0.0, 0.0)], 2,
        )  # fmt: skip
        pulls.append(rows[-1, 1, 2])
    rough, rougher = pulls[1] - pulls[0], pulls[2] - pulls[0]
    assert rough > 0.0
    assert 3.0 < rougher / rough < 6.0, "4 for a product, 2 for a mean or the larger one"


@pytest.mark.parametrize("backend", SIMULATORS)
def test_wheels_with_little_grip_skid_and_spin(backend: str) -> None:
    skids, starts = [], []
    for grip in (10.0, 1.0, 0.3):
        robot = {"dynamics": "unicycle", "wheel_grip": grip}
        row = drive(backend, [robot], [(0, 0, 0.6, 0)], [(1, 1)], 4)[-1, 0]
        vx, vy, ux, uy = row[2:6]
        skids.append(abs(vy * ux - vx * uy))
        starts.append(drive(backend, [robot], [(0, 0, 0, 0)], [(1, 0)], 2)[-1, 0, 2])
    assert skids[0] < 0.05
    assert 0.2 < skids[1] < skids[2]
    np.testing.assert_allclose(starts, [0.3, 0.2, 0.06], rtol=1e-4)


@pytest.mark.parametrize("backend", SIMULATORS)
def test_grip_limits_the_forces_along_and_across_together(backend: str) -> None:
    """A robot that slides sideways and drives off, over one control step of 0.1 s."""
    changes = []
    for grip in (0.5, 1.0, 10.0):
        robot = {"dynamics": "unicycle", "wheel_grip": grip}
        row = drive(backend, [robot], [(0, 0, 0, 0.6)], [(1, 0)], 1)[-1, 0]
        changes.append((row[2], 0.6 - row[3]))
    np.testing.assert_allclose(changes[0], (0.05 * ACROSS, 0.05 * ACROSS), rtol=1e-4)
    np.testing.assert_allclose(changes[1], (0.1 * ACROSS, 0.1 * ACROSS), rtol=1e-4)
    np.testing.assert_allclose(changes[2], (0.15, 0.6), rtol=1e-4)  # as in published worlds


@pytest.mark.parametrize("backend", ["pymunk", "mujoco", "kinematic"])
@pytest.mark.parametrize("command", [(1.0, 1.0), (-1.0, 0.5), (0.3, -1.5), (0.4, 0.6)])
def test_the_wheels_of_a_differential_drive_share_their_speed(
    backend: str, command: tuple[float, float]
) -> None:
    if backend == "mujoco":
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    robot = Robot(dynamics="unicycle", drive="differential", max_acceleration=6.0)
    team = [{"count": 1, "robot": robot.model_dump()}]
    env = make_env(TaskSpec.parse({"team": team, "obstacles": NO_OBSTACLES, "backend": backend}))
    env.reset(np.array([3], np.uint64))
    steps = [env.step(np.array([[command]], np.float32)) for _ in range(3)]
    (x0, y0), (x1, y1) = (each.states[0, [UX, UY]].astype(float) for each in steps[-2:])
    speed = float(steps[-1].states[0, [VX, VY]] @ (x1, y1))
    turn = math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1) / 0.1
    share = (speed / robot.max_speed, turn / robot.max_turn_rate)
    clipped = np.clip(command, -1, 1)
    np.testing.assert_allclose(share, clipped / max(np.abs(clipped).sum(), 1.0), atol=0.01)


def test_what_a_robot_or_a_simulator_has_not_is_refused() -> None:
    with pytest.raises(SpecError, match=r"wheel_grip is 3 m/s\^2, but a holonomic robot has no wh"):
        Robot.parse({"wheel_grip": 3.0})
    with pytest.raises(SpecError, match="of two wheels, got dynamics holonomic and command vel"):
        Robot.parse({"drive": "differential"})
    with pytest.raises(SpecError, match="got dynamics unicycle and command acceleration"):
        Robot.parse({"drive": "differential", "dynamics": "unicycle", "command": "acceleration"})
    rough = [{"robot": {"friction": 0.5}}]
    with pytest.raises(SpecError, match=r"kinematic has no contacts\. Leave friction out"):
        TaskSpec.parse({"team": rough, "backend": "kinematic"})
