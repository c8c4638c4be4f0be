"""Free motion: the bits of Munk2D, bounds that hold, and a solver that forgets."""

import math

import numpy as np
import pymunk
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.envs.physics.backend import Backend, Contacts, Moving, Plan
from swarmdata.envs.physics.dynamics import drive, limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.fast_backend import FastBackend, integrates_exactly
from swarmdata.envs.physics.free_motion import (
    EXACT_GAP_LIMIT,
    is_free,
    move,
    static_gap,
    write_travel_bounds,
)
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.envs.world.world import MakeBackend, make_backend
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import SEPARATION_GAP, Double, Float

REALS = st.floats(-10.0, 10.0)


@given(row=st.tuples(*[REALS] * 6), dt=st.sampled_from([0.05, 0.0165, 0.1 / 3]))
def test_move_has_the_bits_of_munk2d(row: tuple[float, ...], dt: float) -> None:
    x, y, vx, vy, ax, ay = row
    space, body = pymunk.Space(), pymunk.Body(1.0, math.inf)
    space.add(body)
    body.position, body.velocity, body.force = (x, y), (vx, vy), (ax, ay)
    space.step(dt)
    robots = np.array([[x, y, vx, vy, 1.0, 0.0]])
    move(robots, np.array([[ax, ay]]), dt)
    stepped = np.array([*body.position, *body.velocity])
    assert stepped.tobytes() == robots[0, :4].tobytes()


def test_this_machine_integrates_exactly() -> None:
    """Else every world here would run on the slow backend."""
    assert integrates_exactly()


@pytest.mark.parametrize(
    "robot",
    [
        {},
        {"command": "acceleration"},
        {"dynamics": "unicycle"},
        {"dynamics": "unicycle", "command": "acceleration"},
    ],
)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_no_robot_travels_further_than_its_bound(robot: dict[str, str], seed: int) -> None:
    spec = TaskSpec.model_validate({"team": [{"count": 8, "robot": robot}]})
    limits, dt, n_substeps = limits_of(spec), spec.physics_dt, spec.n_substeps
    rng = np.random.default_rng(seed)
    robots = rng.uniform(-0.9, 0.9, (8, 6))  # faster than max_speed too, as after a push
    robots[:, 4:] /= np.linalg.norm(robots[:, 4:], axis=1, keepdims=True)
    commands = rng.uniform(-0.7, 0.7, (8, 2))
    bounds, accelerations, start = np.zeros(8), np.zeros((8, 2)), robots[:, :2].copy()
    write_travel_bounds(robots, limits, n_substeps * dt, bounds)
    for k in range(n_substeps):
        drive(robots, commands, limits, n_substeps, dt, k, accelerations)
        move(robots, accelerations, dt)
        assert (np.linalg.norm(robots[:, :2] - start, axis=1) <= bounds).all()


@pytest.mark.parametrize("name", ["coop_nav", "formation", "warehouse"])
def test_static_gap_is_exact_up_to_its_limit(name: str) -> None:
    spec = preset(name)
    step = make_env(spec, 8).reset(np.arange(8, dtype=np.uint64))
    half, rng = np.array(spec.half_size), np.random.default_rng(0)
    n_near = 0
    for layout in step.layouts:
        for x, y in rng.uniform(-half, half, (50, 2)):
            exact = clearance(x, y, layout, half) - 0.12
            found = static_gap(x, y, 0.12, layout, half)
            assert found == pytest.approx(min(exact, EXACT_GAP_LIMIT), abs=1e-12)
            n_near += exact < EXACT_GAP_LIMIT
    assert n_near > 50


def test_gaps_decide() -> None:
    """Two robots and a wall, a little above and below the separation."""
    radii, half, layout = np.full(2, 0.1), np.full(2, 1.0), np.zeros((0, 8), np.float32)
    none = np.zeros(2)

    def apart(robots: list[list[float]], ahead: float = 0.0) -> bool:
        rows = np.array([[*row, 1.0, 0.0] for row in robots])
        return bool(is_free(rows, ahead, none, radii, layout, half, np.zeros((2, 3))))

    gap, little = SEPARATION_GAP, 1e-6
    assert apart([[0, 0, 0, 0], [0.2 + gap + little, 0, 0, 0]])
    assert not apart([[0, 0, 0, 0], [0.2 + gap - little, 0, 0, 0]])
    assert apart([[0, 0, 0, 0], [0, 0.9 - gap - little, 0, 0]])
    assert not apart([[0, 0, 0, 0], [0, 0.9 - gap + little, 0, 0]])
    assert not apart([[0, 0, 1, 0], [0.25, 0, 0, 0]], ahead=0.05)


@pytest.mark.parametrize("backend", [make_backend, PublicBackend])
def test_free_motion_forgets_what_was_before(backend: MakeBackend) -> None:
    """A world that goes on equals a new one that starts in its state, contacts and all."""
    spec = preset("coop_nav-n3")
    task, n = make_task(spec), spec.n_agents
    env, policy = TaskEnv(task, 1, backend), make_policy("random", spec)
    step = env.reset(np.array([1], dtype=np.uint64))
    policy.reset(step, np.arange(1))
    world, active = env._blocks[0]._world, np.array([True])
    inner = world._backend
    robots = inner.spaces.robots if isinstance(inner, FastBackend) else inner._robots  # type: ignore[attr-defined]  # states are rounded to float32
    half, has_touched, n_later_contacts = np.array(spec.half_size), False, 0
    other: Backend | None = None
    contacts = world.contacts
    for _ in range(spec.horizon - 1):
        step = env.step(policy.act(step))
        if other is not None:
            states, events = step.states.copy(), np.zeros_like(step.events)
            states[:, : 8 * n] = 0.0
            other.step(active, world._commands, contacts, events, states)
            columns = [8 * i + c for i in range(n) for c in range(6)]
            assert states[:, columns].tobytes() == step.states[:, columns].tobytes()
            assert events.tobytes() == step.events.tobytes()
            n_later_contacts += int(events.sum())
        has_touched |= bool(step.events.any())
        if other is None and has_touched and _smallest_gap(robots[0], step.layouts[0], half) > 0.15:
            other = backend(Plan(spec, task.kinds, ()), 1)
            moving = Moving(robots.copy(), np.zeros((1, 0, 7)), limits_of(spec), payload_rows(()))
            other.reset(np.arange(1), step.layouts, moving)
            contacts = Contacts._make(np.zeros_like(array) for array in world.contacts)
    assert n_later_contacts > 3


def _smallest_gap(robots: Double, layout: Float, half: Double) -> float:
    """The smallest gap of robots of radius 0.12 m in a state."""
    places = robots[:, :2]
    gaps = [clearance(x, y, layout, half) - 0.12 for x, y in places.tolist()]
    for i, place in enumerate(places):
        gaps += (np.linalg.norm(places[i + 1 :] - place, axis=1) - 0.24).tolist()
    return min(gaps)
