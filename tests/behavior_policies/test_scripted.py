"""The scripted controller in a kinematic toy and in the world."""

import hashlib

import numpy as np
import pytest

from swarmdata.behavior_policies.navigation.avoidance import gives_way
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.numerics.geometry import CIRCLE, POCKET, clearance
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.task_spec import Obstacles, Role, TaskSpec
from swarmdata.types import Double, Float, Step, blank_step

HALF = np.array([2.0, 2.0])
EMPTY = np.zeros((0, 8), dtype=np.float32)
NO_OBSTACLES = Obstacles(circles=0, boxes=0, corners=0, pockets=0)
DIAMETER = 0.24


def spec_of(n_robots: int, obstacles: Obstacles = NO_OBSTACLES) -> TaskSpec:
    return TaskSpec(team=(Role(count=n_robots),), obstacles=obstacles)


def toy_step(robots: Double, layout: Float) -> Step:
    """One copy with the given rows of (x, y, vx, vy, goal x, goal y)."""
    n = len(robots)
    ahead = np.broadcast_to([1.0, 0.0], (n, 2))
    states = np.concatenate([robots[:, :4], ahead, robots[:, 4:]], axis=1)
    observations = np.zeros((1, n, 53), dtype=np.float32)
    return blank_step(observations, states.reshape(1, -1).astype(np.float32), layouts=layout[None])


def drive(spec: TaskSpec, starts: Double, goals: Double, layout: Float = EMPTY) -> Double:
    """Paths of point robots with an acceleration limit until all arrive, [T, N, 2]."""
    robots = np.concatenate([starts, np.zeros_like(starts), goals], axis=1)
    policy = Scripted(spec)
    policy.reset(toy_step(robots, layout), np.arange(1))
    paths = [robots[:, :2].copy()]
    for _ in range(200):
        change = 0.6 * policy.act(toy_step(robots, layout))[0] - robots[:, 2:4]
        size = np.linalg.norm(change, axis=1, keepdims=True)
        robots[:, 2:4] += change * np.minimum(1.0, 0.15 / np.maximum(size, 1e-9))
        robots[:, :2] += 0.1 * robots[:, 2:4]
        paths.append(robots[:, :2].copy())
        if (np.linalg.norm(robots[:, :2] - goals, axis=1) < 0.15).all():
            return np.array(paths)
    raise AssertionError(f"not arrived after 200 steps: {robots[:, :2]} goals {goals}")


def smallest_separation(paths: Double) -> float:
    offset = paths[:, :, None] - paths[:, None, :]
    distance = np.linalg.norm(offset, axis=-1) + 9.0 * np.eye(paths.shape[1])
    return float(distance.min())


def smallest_clearance(paths: Double, layout: Float) -> float:
    return min(float(clearance(x, y, layout, HALF)) for x, y in paths.reshape(-1, 2))


@pytest.mark.parametrize(("n_robots", "most_steps"), [(2, 75), (4, 150), (8, 150)])
def test_robots_swap_places_across_a_circle(n_robots: int, most_steps: int) -> None:
    """3 m at 0.6 m/s are 50 steps."""
    angles = 2 * np.pi * np.arange(n_robots) / n_robots
    starts = 1.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    paths = drive(spec_of(n_robots), starts, -starts)
    assert smallest_separation(paths) > DIAMETER
    assert len(paths) < most_steps


def test_a_robot_gets_out_of_a_pocket() -> None:
    layout = np.array([[POCKET, 0.0, 0.0, 0.0, 1.0, 0.4, 0.4, 0.05]], dtype=np.float32)
    spec = spec_of(1, Obstacles(circles=0, boxes=0, corners=0, pockets=1))
    paths = drive(spec, np.array([[0.15, 0.05]]), np.array([[1.2, 0.0]]), layout)
    assert smallest_clearance(paths, layout) > DIAMETER / 2


def gate(width: float) -> Float:
    """Two rows of circles with one passage between them at the origin, along x."""
    centers = [sign * (width / 2 + 0.25 + 0.5 * k) for k in range(4) for sign in (-1, 1)]
    return np.array([[CIRCLE, 0.0, y, 1.0, 0.0, 0.25, 0.25, 0.0] for y in centers], np.float32)


def test_a_robot_takes_the_narrowest_passage_of_the_spec() -> None:
    layout, spec = gate(0.34), spec_of(1, NO_OBSTACLES.model_copy(update={"circles": 8}))
    paths = drive(spec, np.array([[-1.0, 0.6]]), np.array([[1.0, -0.5]]), layout)
    assert smallest_clearance(paths, layout) > DIAMETER / 2


def test_a_robot_at_its_goal_in_a_passage_makes_room_and_comes_back() -> None:
    layout, spec = gate(0.4), spec_of(2, NO_OBSTACLES.model_copy(update={"circles": 8}))
    starts = np.array([[0.0, 0.0], [-1.2, 0.1]])
    goals = np.array([[0.0, 0.0], [1.2, 0.0]])
    paths = drive(spec, starts, goals, layout)
    assert np.linalg.norm(paths[:, 0], axis=1).max() > 0.2
    assert smallest_separation(paths) > DIAMETER
    assert smallest_clearance(paths, layout) > DIAMETER / 2


def test_right_of_way_is_never_mutual() -> None:
    assert gives_way(0.1, 0.3)
    assert not gives_way(0.3, 0.1)
    assert not gives_way(0.2, 0.2)
    assert not gives_way(0.6, 0.9)


def test_messages_are_zero_and_noise_is_on_commands_only() -> None:
    channel = {"kind": "broadcast", "payload": "learned", "message_size": 3}
    spec = TaskSpec().with_updates(communication=channel)
    step = make_env(spec, 2).reset(evaluation_seeds(2))
    policy = Scripted(spec, noise=0.2)
    policy.reset(step, np.arange(2))
    actions = policy.act(step)
    assert actions.shape == (2, 4, 5)
    assert actions[..., :2].all()
    assert not actions[..., 2:].any()


def test_the_default_task_is_driven_by_the_same_bits_as_ever() -> None:
    """Datasets are rebuilt from these bits."""
    spec = preset("coop_nav")
    env, policy, digest = make_env(spec, 8), Scripted(spec), hashlib.sha256()
    step = env.reset(evaluation_seeds(8))
    policy.reset(step, np.arange(8))
    for _ in range(80):
        actions = policy.act(step)
        digest.update(actions.tobytes())
        step = env.step(actions)
    assert digest.hexdigest()[:16] == "b368fbbe50c527f6"
