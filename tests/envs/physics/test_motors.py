"""Motors: commands arrive late, are followed with a lag, and are forgotten at a reset."""

import numpy as np

from swarmdata.envs.physics.dynamics import Motors
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import Robot, Role, TaskSpec
from swarmdata.types import Double
from tests.envs.worlds import NO_OBSTACLES

ALL = np.ones(2, np.bool_)
SEEDS = np.arange(2, dtype=np.uint64)


def spec_of(*robots: Robot) -> TaskSpec:
    team = [Role(name=f"r{k}", count=1, robot=robot) for k, robot in enumerate(robots)]
    return TaskSpec(team=tuple(team))


def motors_of(*robots: Robot) -> Motors:
    motors = Motors.of(spec_of(*robots), 2)
    assert motors is not None
    motors.reset(np.arange(2), SEEDS)
    return motors


def followed(motors: Motors, given: Double, first: int = 1) -> Double:
    """What reaches the motors of commands [T, E, N, 2], from step `first` on."""
    rows = []
    for t, row in enumerate(given, first):
        commands = row.copy()
        motors.follow(ALL, np.full(2, t), commands)
        rows.append(commands)
    return np.array(rows)


def test_robots_without_either_have_no_motors() -> None:
    assert Motors.of(TaskSpec(), 4) is None


def test_each_robot_has_its_own_delay() -> None:
    motors = motors_of(Robot(), Robot(command_delay=1), Robot(command_delay=3))
    given = np.random.default_rng(0).uniform(-1, 1, (8, 2, 3, 2))
    arrived = followed(motors, given)
    for i, delay in enumerate((0, 1, 3)):
        np.testing.assert_array_equal(arrived[delay:, :, i], given[: 8 - delay, :, i])
        assert not arrived[:delay, :, i].any(), "nothing has arrived yet"
    motors.reset(np.array([0]), SEEDS[:1])
    again = followed(motors, given)
    np.testing.assert_array_equal(again, arrived)


def test_a_late_robot_drives_the_same_way_later() -> None:
    spec = TaskSpec.parse({"obstacles": NO_OBSTACLES, "team": [{"count": 1}]})
    late = spec.with_updates(team=[{"count": 1, "robot": {"command_delay": 3}}])
    paths = []
    for each in (spec, late):
        env = make_env(each)
        start = env.reset(np.array([2], np.uint64)).states[0, :2]
        command = np.array([[[0.5, 0.2]]])
        paths.append(np.array([env.step(command).states[0, :2] - start for _ in range(9)]))
    np.testing.assert_array_equal(paths[1][:3], 0.0)
    np.testing.assert_allclose(paths[1][3:], paths[0][:6], atol=1e-6)


def test_each_episode_draws_its_own_delays_and_lags() -> None:
    ranges = {"command_delay": (0, 3), "actuator_lag": (0.1, 0.5)}
    spec = spec_of(*[Robot()] * 3).with_updates(randomization=ranges)
    motors, seeds = Motors.of(spec, 2), np.array([5, 8], np.uint64)
    assert motors is not None
    drawn = drawn_values(spec, seeds)
    motors.reset(np.arange(2), seeds)
    arrived = followed(motors, np.ones((12, 2, 3, 2)))[..., 0]
    for b in range(2):
        for i in range(3):
            delay, lag = int(drawn["command_delay"][b, i]), drawn["actuator_lag"][b, i]
            steps = np.clip(np.arange(1, 13) - delay, 0, None)
            expected = 1.0 - np.exp(-0.1 * steps / lag)
            np.testing.assert_allclose(arrived[:, b, i], expected, rtol=1e-12)
    motors.reset(np.array([0]), seeds[1:])
    again = followed(motors, np.ones((12, 2, 3, 2)))[:, 0, :, 0]
    np.testing.assert_array_equal(again, arrived[:, 1])
