"""Payloads in all simulators: one robot pushes in vain, two do not; friction stops what moves."""

from collections.abc import Sequence

import numpy as np
import pytest

from swarmdata.numerics.random import derive, uniform
from swarmdata.specs.rules import Payload
from swarmdata.types import Double
from tests.envs.physics.scenes import Scene

RADIUS = 0.12
BOX = Payload(shape="box", half_length=0.35, half_width=0.25, mass=4.0, friction=2.5)
DISC = BOX.model_copy(update={"shape": "circle"})
TURNING = BOX.model_copy(update={"friction_limit": "ellipsoid"})


SIMULATORS = pytest.mark.parametrize("simulator", ["pymunk", "mujoco"])
"""MuJoCo stops bodies after they have begun to overlap: its tolerances are wider."""


def scene_of(
    payload: Payload, levers: Sequence[float], simulator: str = "pymunk", gap: float = 0.01
) -> Scene:
    """One payload at the origin, and robots on its -y side at the given x, `gap` away."""
    side = np.full(len(levers), payload.half_width)
    if payload.shape == "circle":
        side = np.sqrt((payload.half_length + RADIUS) ** 2 - np.square(levers)) - RADIUS
    rows = [(x, -(y + RADIUS + gap), 0, 0) for x, y in zip(levers, side.tolist(), strict=True)]
    return Scene([{}] * len(rows), rows, simulator, payloads=(payload,), size=12.0)


def drive(scene: Scene, commands: Sequence[Sequence[float]], n_steps: int) -> Double:
    """The payload's rows while the robots keep to commands, [n_steps, 7]."""
    return scene.drive(commands, n_steps)[1][:, 0]


@SIMULATORS
@pytest.mark.parametrize("payload", [BOX, DISC], ids=["box", "disc"])
def test_one_robot_pushes_in_vain_and_two_move_it(payload: Payload, simulator: str) -> None:
    creep = 2e-3 if simulator == "mujoco" else 1e-4
    alone = drive(scene_of(payload, [0.0], simulator), [[0, 1]], 80)
    assert abs(alone[-1, 1]) < 0.01
    np.testing.assert_allclose(alone[20:, 1], alone[-1, 1], atol=creep)
    scene = scene_of(payload, [-0.15, 0.15], simulator)
    inward = -scene.robots[0, :, :2] if payload.shape == "circle" else np.array([[0.0, 1.0]] * 2)
    pair = drive(scene, (inward / np.linalg.norm(inward, axis=1, keepdims=True)).tolist(), 80)
    assert pair[-1, 1] > 0.5
    assert abs(pair[-1, 0]) < (0.01 if simulator == "mujoco" else 1e-3)


def test_a_run_up_moves_it_by_centimetres_only() -> None:
    assert drive(scene_of(BOX, [0.0], gap=0.4), [[0, 1]], 80)[-1, 1] < 0.04


def test_one_robot_does_not_turn_a_box() -> None:
    rows = drive(scene_of(BOX, [0.3]), [[0, 1]], 80)
    assert abs(rows[-1, 5]) < 0.04  # from the bump at the start
    np.testing.assert_allclose(rows[20:, 5], rows[-1, 5], atol=1e-4)


@SIMULATORS
def test_it_accelerates_and_stops_as_force_friction_and_mass_say(simulator: str) -> None:
    scene = scene_of(BOX, [-0.3, 0.0, 0.3], simulator, gap=0.0)
    moving = drive(scene, [[0, 1]] * 3, 12)
    steady = np.diff(moving[2:6, 3]) / 0.1
    np.testing.assert_allclose(steady, (3 * 1.5 - 2.5) / (3 + 4), rtol=0.1)
    resting = drive(scene, [[0, 0]] * 3, 40)
    way, speed = resting[-1, 1] - moving[-1, 1], moving[-1, 3]
    assert abs(resting[-1, 3]) < 1e-3
    assert way == pytest.approx(speed**2 / (2 * 2.5 / 4.0), rel=0.2)  # v^2 / (2 friction / mass)


@SIMULATORS
def test_a_couple_turns_it_on_the_spot(simulator: str) -> None:
    scene = scene_of(BOX, [-0.33, 0.33], simulator)
    scene.robots[0, 1, 1] *= -1.0
    scene.reset()
    rows = drive(scene, [[0, 1], [0, -1]], 20)
    assert rows[-1, 5] < -0.2
    np.testing.assert_allclose(rows[:, 4] ** 2 + rows[:, 5] ** 2, 1.0, atol=1e-6)


@pytest.mark.parametrize(("lever", "least"), [(0.0, -1.0), (0.04, 15.0), (0.1, 45.0), (0.15, 55.0)])
def test_a_push_beside_the_middle_turns_what_slides_as_in_mujoco(
    lever: float, least: float
) -> None:
    levers = [lever - 0.125, lever + 0.125]
    forward = [[0.0, 1.0]] * 2
    ours = drive(scene_of(TURNING, levers), forward, 30)[-1]
    theirs = drive(scene_of(TURNING, levers, "mujoco"), forward, 30)[-1]
    angles = [np.degrees(np.arctan2(row[5], row[4])) for row in (ours, theirs)]
    assert angles[0] > least
    assert angles[0] == pytest.approx(angles[1], abs=3.0)
    np.testing.assert_allclose(ours[:2], theirs[:2], atol=0.04)
    apart = drive(scene_of(BOX, levers), forward, 30)[-1]
    assert abs(np.degrees(np.arctan2(apart[5], apart[4]))) < 1.0


@pytest.mark.parametrize("payload", [BOX, DISC, TURNING], ids=["box", "disc", "turning"])
@pytest.mark.parametrize("seed", range(3))
def test_both_backends_and_a_second_episode_give_the_same_bits(payload: Payload, seed: int) -> None:
    levers = [-0.25, 0.05, 0.31]
    fast, public = scene_of(payload, levers), scene_of(payload, levers, "public")

    def play(scene: Scene) -> Double:
        scene.reset()
        parts = []
        for t in range(12):
            draws = uniform(derive(seed, t, np.arange(6))).reshape(3, 2)
            commands = 2.0 * draws - [1.0, 0.2]  # mostly against the payload
            parts.append(drive(scene, commands.tolist(), 8))
        return np.concatenate([*parts, np.broadcast_to(scene.states[0, :7], (1, 7))])

    first = play(fast)
    assert np.abs(np.diff(first[:-1, :2], axis=0)).max() > 0.0
    np.testing.assert_array_equal(first, play(public))
    np.testing.assert_array_equal(first, play(fast))
