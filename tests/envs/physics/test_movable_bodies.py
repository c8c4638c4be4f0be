"""Payloads in all simulators: one robot pushes in vain, two do not; friction stops what moves."""

from collections.abc import Sequence

import numpy as np
import pytest

from swarmdata.envs.physics.backend import Backend, Contacts, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world.world import MakeBackend, make_backend
from swarmdata.numerics.random import derive, uniform
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import Arena, Role, TaskSpec
from swarmdata.types import Double, Float

RADIUS = 0.12
ONE = np.array([True])
NO_OBSTACLES = np.zeros((1, 0, 8), dtype=np.float32)
BOX = Payload(shape="box", half_length=0.35, half_width=0.25, mass=4.0, friction=2.5)
DISC = BOX.model_copy(update={"shape": "circle"})


class Scene:
    """One payload at the origin, and robots on its -y side at the given x, `gap` away."""

    def __init__(
        self,
        payload: Payload,
        levers: Sequence[float],
        gap: float = 0.01,
        backend: MakeBackend = make_backend,
    ) -> None:
        n = len(levers)
        spec = TaskSpec(team=(Role(count=n),), arena=Arena(width=12.0, height=12.0))
        plan = Plan(spec, np.zeros(0, np.int64), (payload,))
        self.limits, self.payloads = limits_of(spec)[None], payload_rows(plan.movables)
        self.backend = backend(plan, 1)
        self.robots: Double = np.zeros((1, n, 6))
        self.robots[0, :, 0], self.robots[0, :, 4] = levers, 1.0
        side = np.array([payload.half_width] * n)
        if payload.shape == "circle":
            side = np.sqrt((payload.half_length + RADIUS) ** 2 - np.square(levers)) - RADIUS
        self.robots[0, :, 1] = -(side + RADIUS + gap)
        self.states: Float = np.zeros((1, N_COLUMNS * n + 7), dtype=np.float32)
        self.reset()

    def reset(self) -> None:
        n = self.robots.shape[1]
        bodies = np.zeros((1, 1, 7))
        bodies[0, 0, 4] = 1.0
        self.contacts = Contacts(
            robots=np.zeros((1, n, n), np.bool_),
            obstacles=np.zeros((1, n, 4), np.bool_),
            slack=np.zeros((1, n, 3)),
        )
        self.backend.reset(
            np.array([0]), NO_OBSTACLES, self.robots, bodies, self.limits, self.payloads
        )

    def drive(self, commands: Sequence[Sequence[float]], n_steps: int) -> Double:
        """The payload's rows while the robots keep to commands, [n_steps, 7]."""
        events = np.zeros((1, self.robots.shape[1], 4), np.uint8)
        rows = []
        for _ in range(n_steps):
            held = np.array([commands], dtype=np.float64)
            self.backend.step(ONE, held, self.contacts, events, self.states)
            rows.append(self.states[0, -7:].astype(np.float64))
        return np.array(rows)


def mujoco(plan: Plan, n_copies: int) -> Backend:
    """MuJoCo, which stops bodies after they have begun to overlap: tolerances are wider."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    from swarmdata.envs.physics.mujoco_backend import MujocoBackend

    return MujocoBackend(plan, n_copies)


SIMULATORS = pytest.mark.parametrize("backend", [make_backend, mujoco], ids=["pymunk", "mujoco"])


@SIMULATORS
@pytest.mark.parametrize("payload", [BOX, DISC], ids=["box", "disc"])
def test_one_robot_pushes_in_vain_and_two_move_it(payload: Payload, backend: MakeBackend) -> None:
    creep = 2e-3 if backend is mujoco else 1e-4
    alone = Scene(payload, [0.0], backend=backend).drive([[0, 1]], 80)
    assert abs(alone[-1, 1]) < 0.01
    np.testing.assert_allclose(alone[20:, 1], alone[-1, 1], atol=creep)
    scene = Scene(payload, [-0.15, 0.15], backend=backend)
    inward = -scene.robots[0, :, :2] if payload.shape == "circle" else np.array([[0.0, 1.0]] * 2)
    pair = scene.drive((inward / np.linalg.norm(inward, axis=1, keepdims=True)).tolist(), 80)
    assert pair[-1, 1] > 0.5
    assert abs(pair[-1, 0]) < (0.01 if backend is mujoco else 1e-3)


def test_a_run_up_moves_it_by_centimetres_only() -> None:
    assert Scene(BOX, [0.0], gap=0.4).drive([[0, 1]], 80)[-1, 1] < 0.04


def test_one_robot_does_not_turn_a_box() -> None:
    rows = Scene(BOX, [0.3]).drive([[0, 1]], 80)
    assert abs(rows[-1, 5]) < 0.04  # from the bump at the start
    np.testing.assert_allclose(rows[20:, 5], rows[-1, 5], atol=1e-4)


@SIMULATORS
def test_it_accelerates_and_stops_as_force_friction_and_mass_say(backend: MakeBackend) -> None:
    scene = Scene(BOX, [-0.3, 0.0, 0.3], gap=0.0, backend=backend)
    moving = scene.drive([[0, 1]] * 3, 12)
    steady = np.diff(moving[2:6, 3]) / 0.1
    np.testing.assert_allclose(steady, (3 * 1.5 - 2.5) / (3 + 4), rtol=0.1)
    resting = scene.drive([[0, 0]] * 3, 40)
    way, speed = resting[-1, 1] - moving[-1, 1], moving[-1, 3]
    assert abs(resting[-1, 3]) < 1e-3
    assert way == pytest.approx(speed**2 / (2 * 2.5 / 4.0), rel=0.2)  # v^2 / (2 friction / mass)


@SIMULATORS
def test_a_couple_turns_it_on_the_spot(backend: MakeBackend) -> None:
    scene = Scene(BOX, [-0.33, 0.33], backend=backend)
    scene.robots[0, 1, 1] *= -1.0
    scene.reset()
    rows = scene.drive([[0, 1], [0, -1]], 20)
    assert rows[-1, 5] < -0.2
    np.testing.assert_allclose(rows[:, 4] ** 2 + rows[:, 5] ** 2, 1.0, atol=1e-6)


@pytest.mark.parametrize("payload", [BOX, DISC], ids=["box", "disc"])
@pytest.mark.parametrize("seed", range(3))
def test_both_backends_and_a_second_episode_give_the_same_bits(payload: Payload, seed: int) -> None:
    levers = [-0.25, 0.05, 0.31]
    fast, public = Scene(payload, levers), Scene(payload, levers, backend=PublicBackend)

    def play(scene: Scene) -> Double:
        scene.reset()
        parts = []
        for t in range(12):
            draws = uniform(derive(seed, t, np.arange(6))).reshape(3, 2)
            commands = 2.0 * draws - [1.0, 0.2]  # mostly against the payload
            parts.append(scene.drive(commands.tolist(), 8))
        return np.concatenate([*parts, np.broadcast_to(scene.states[0, :7], (1, 7))])

    first = play(fast)
    assert np.abs(np.diff(first[:-1, :2], axis=0)).max() > 0.0
    np.testing.assert_array_equal(first, play(public))
    np.testing.assert_array_equal(first, play(fast))
