"""Commands that give robots of every drive the velocity they should have."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.behavior_policies.navigation.orca import damper_half_plane
from swarmdata.behavior_policies.navigation.velocity_tracking import (
    command_of,
    speed_along,
    turn_command,
)
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.registry.components import make_task
from swarmdata.specs.state_layout import UX, UY, VX, VY, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double
from tests.envs.worlds import NO_OBSTACLES

NOTHING = np.empty((0, 4))
ANGLES = st.floats(-3.1, 3.1)


def spec_of(**robot: Any) -> TaskSpec:
    return TaskSpec.parse({"team": [{"count": 1, "robot": robot}], "obstacles": NO_OBSTACLES})


def unit(angle: float) -> tuple[float, float]:
    return float(np.cos(angle)), float(np.sin(angle))


def driven(spec: TaskSpec, wish: tuple[float, float], n_steps: int) -> Double:
    """The robot's state after tracking a velocity, from rest."""
    env = TaskEnv(make_task(spec), 1, KinematicBackend)
    step, limit = env.reset(np.zeros(1, np.uint64)), limits_of(spec)[0]
    command = np.empty(2)
    for _ in range(n_steps):
        robot = robots_of(step.states, 1)[0, 0].astype(np.float64)
        moving, heading = (robot[VX], robot[VY]), (robot[UX], robot[UY])
        command_of(moving, heading, wish, limit, NOTHING, 0, spec.control_dt, command)
        assert np.abs(command).max() <= 1.0
        step = env.step(command[None, None])
    return robots_of(step.states, 1)[0, 0].astype(np.float64)


DIFFERENTIAL = {"dynamics": "unicycle", "drive": "differential"}


@pytest.mark.parametrize("angle", [0.0, 0.9, 2.0, -2.9])
def test_a_differential_drive_turns_and_drives_within_its_wheels_speed(angle: float) -> None:
    (ux, uy), spec, command = unit(angle), spec_of(**DIFFERENTIAL), np.empty(2)
    for speed in (0.12, 0.42, 0.6):
        command_of(
            (0.0, 0.0), (1.0, 0.0), (speed * ux, speed * uy), limits_of(spec)[0], NOTHING, 0,
            spec.control_dt, command,
        )  # fmt: skip
        assert np.abs(command).sum() <= 1.0 + 1e-12


@pytest.mark.parametrize(
    "robot",
    [
        DIFFERENTIAL,
        *({"dynamics": dynamics, "command": command} for dynamics in ("holonomic", "unicycle")
          for command in ("velocity", "acceleration")),
    ],
)  # fmt: skip
@pytest.mark.parametrize("angle", [0.0, 0.9, 2.0, -2.9])
def test_every_drive_comes_to_the_velocity(robot: dict[str, str], angle: float) -> None:
    wish = (0.5 * unit(angle)[0], 0.5 * unit(angle)[1])
    reached = driven(spec_of(**robot), wish, 30)
    np.testing.assert_allclose(reached[[VX, VY]], wish, atol=2e-3)


def test_a_unicycle_backs_up_when_it_should_go_back_slowly() -> None:
    limit = limits_of(spec_of(dynamics="unicycle"))[0]
    assert turn_command((1.0, 0.0), (-0.2, 0.02), limit, 0.1) < 0.0  # the tail turns to the wish
    assert turn_command((1.0, 0.0), (-0.5, 0.02), limit, 0.1) == 1.0  # the nose does


def test_a_robot_that_should_stand_does_not_turn() -> None:
    limit = limits_of(spec_of(dynamics="unicycle"))[0]
    assert turn_command((1.0, 0.0), (0.0, 1e-4), limit, 0.1) == 0.0


@given(heading=ANGLES, wish=ANGLES)
def test_turning_never_leads_away(heading: float, wish: float) -> None:
    """The heading's axis is at least as near to the wish afterwards, and the turn is in bounds."""
    limit = limits_of(spec_of(dynamics="unicycle"))[0]
    (hx, hy), (wx, wy) = unit(heading), unit(wish)
    turn = turn_command((hx, hy), (0.6 * wx, 0.6 * wy), limit, 0.1)
    assert -1.0 <= turn <= 1.0
    after = heading + 3.0 * 0.1 * turn
    assert np.cos(after - wish) >= np.cos(heading - wish) - 1e-2


@given(
    heading=ANGLES, wish=ANGLES, walls=st.lists(st.tuples(ANGLES, st.floats(0.0, 0.5)), max_size=5)
)
def test_the_speed_along_a_heading_is_the_best_that_all_half_planes_allow(
    heading: float, wish: float, walls: list[tuple[float, float]]
) -> None:
    """Against a search over a grid; a stop is always allowed here."""
    planes = np.empty((len(walls), 4))
    for row, (angle, bound) in zip(planes, walls, strict=True):
        damper_half_plane(*unit(angle), bound, row)
    (hx, hy), (wx, wy) = unit(heading), unit(wish)
    speed = speed_along((hx, hy), (0.6 * wx, 0.6 * wy), 0.6, planes, len(walls))
    grid = np.linspace(-0.6, 0.6, 1201)
    allowed = np.ones(1201, dtype=np.bool_)
    for angle, bound in walls:
        allowed &= grid * np.cos(angle - heading) <= bound + 1e-9
    wanted = 0.6 * np.cos(heading - wish)
    best = grid[allowed][np.abs(grid[allowed] - wanted).argmin()]
    assert speed == pytest.approx(best, abs=1.1e-3)


def test_where_no_speed_is_safe_what_comes_first_counts() -> None:
    planes = np.empty((2, 4))
    damper_half_plane(1.0, 0.0, -0.1, planes[0])  # back off at 0.1 m/s at least
    damper_half_plane(-1.0, 0.0, 0.0, planes[1])  # do not go back
    assert speed_along((1.0, 0.0), (0.3, 0.0), 0.6, planes, 2) == pytest.approx(-0.1)
