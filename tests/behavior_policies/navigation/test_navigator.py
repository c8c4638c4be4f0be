"""The navigator: given targets, moving targets, mixed teams, and scales of robots."""

import numpy as np
import pytest

from swarmdata.behavior_policies.navigation.avoidance import stopping_half_planes
from swarmdata.behavior_policies.navigation.navigator import Navigator
from swarmdata.behavior_policies.navigation.robot_scales import (
    LENGTH_SCALE,
    TIME_SCALE,
    Team,
    scales_of,
)
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import Robot, Role, TaskSpec
from swarmdata.types import Step
from tests.envs.worlds import NO_OBSTACLES

EASY = preset("coop_nav-easy")
OPEN = EASY.with_updates(obstacles=NO_OBSTACLES)


def scales(**changes: float | str) -> tuple[float, float]:
    time, length = scales_of(TaskSpec(team=(Role(robot=Robot.parse(changes)),)))[0]
    return float(time), float(length)


def test_the_default_robot_is_the_reference() -> None:
    assert scales() == (1.0, 1.0)
    assert scales(command="acceleration") == (1.0, 1.0)


def test_scales_follow_brakes_size_and_turns() -> None:
    assert scales(max_acceleration=0.5)[TIME_SCALE] == pytest.approx(3.0)
    assert scales(max_acceleration=0.5)[LENGTH_SCALE] == pytest.approx(3.0)
    assert scales(max_speed=0.3) == pytest.approx((2.0, 1.0))  # two radii take twice as long
    assert scales(dynamics="unicycle", max_turn_rate=1.0)[TIME_SCALE] == pytest.approx(
        np.pi / 2 / 0.8
    )
    assert scales(dynamics="unicycle", max_turn_rate=9.0) == (1.0, 1.0)


def begun(spec: TaskSpec) -> tuple[VecEnv, Navigator, Step]:
    env, navigator = make_env(spec, 1), Navigator(spec)
    step = env.reset(np.array([4], dtype=np.uint64))
    navigator.reset(step, np.arange(1))
    return env, navigator, step


@pytest.mark.parametrize("dynamics", ["holonomic", "unicycle"])
def test_a_drift_that_is_known_leaves_no_lag(dynamics: str) -> None:
    role = Role(count=1, robot=Robot.parse({"dynamics": dynamics}))
    spec = OPEN.with_updates(team=[role])
    lags = {}
    for known in (True, False):
        targets = np.array([[-1.5, -1.0]])
        env, navigator, step = begun(spec)
        drifts = np.array([[[0.2, 0.0]]]) if known else None
        for _ in range(120):
            step = env.step(navigator.commands(step, targets[None], drifts))
            targets[0, 0] += 0.02
        lags[known] = float(np.linalg.norm(robots_of(step.states, 1)[0, 0, [X, Y]] - targets[0]))
    assert lags[True] < 0.03
    assert lags[False] == pytest.approx(0.1, abs=0.03)  # 0.2 m/s over a rate of 2 / s


def test_paths_are_planned_anew_when_targets_jump() -> None:
    """Two targets on the two sides of a wall with a door, one after the other."""
    spec = preset("coop_nav-doorway").with_updates(team=[{"count": 1}], horizon=400)
    env, navigator, step = begun(spec)
    for goal in ([1.0, 1.5], [-1.0, 1.5], [1.0, -1.5]):  # none of them the robot's own goal
        for _ in range(120):
            step = env.step(navigator.commands(step, np.array([[goal]])))
        np.testing.assert_allclose(robots_of(step.states, 1)[0, 0, [X, Y]], goal, atol=0.05)


def test_targets_of_the_states_are_the_default() -> None:
    step, navigator = make_env(EASY, 3).reset(np.arange(3, dtype=np.uint64)), Navigator(EASY)
    navigator.reset(step, np.arange(3))
    targets = robots_of(step.states, 4)[..., [TX, TY]].astype(np.float64)
    np.testing.assert_array_equal(
        navigator.commands(step), navigator.commands(step, targets, np.zeros((3, 4, 2)))
    )


def test_stops_are_shared_half_and_half_and_never_ask_to_back_off() -> None:
    robot = {"radius": 0.1, "max_speed": 0.6}
    spec = TaskSpec.parse({"team": [{"count": 3, "robot": robot}]})
    team = Team.of(spec)._replace(stopping_times=np.array([0.5, 1.0, 0.5]))
    robots = np.array([[0.0, 0.0], [0.41, 0.0], [0.0, 0.15]])
    planes = np.empty((3, 4))
    assert stopping_half_planes(0, robots, team, 0, planes) == 2
    bounds = planes[:2, 0] * -planes[:2, 3] + planes[:2, 1] * planes[:2, 2]
    towards = np.stack([planes[:2, 3], -planes[:2, 2]], axis=1)
    np.testing.assert_allclose(towards, [[1.0, 0.0], [0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(-bounds, [0.5 * 0.2 / 1.0, 0.0], atol=1e-12)
    far = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]])
    assert stopping_half_planes(0, far, team, 0, planes) == 0
