"""Transport: its rules against NumPy twins, its episodes, and by hand."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.transport.payload import count_contacts, count_pushes, payload_radius, shape_of
from swarmdata.envs.transport.transport import Transport
from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import clearance, nearest
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.rollouts.action_probabilities import noisy_log_probs
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Episode, Float, Int, Seeds, Step
from tests.envs.worlds import seeds_of

DEFAULT = preset("transport")
POSED: dict[str, Any] = {"payload": {"shape": "box"}, "goal_angle": 0.2}


def with_rules(base: TaskSpec = DEFAULT, **rules: Any) -> TaskSpec:
    return base.with_updates(rules={"task": "transport", **rules})


BOX = with_rules(payload={"shape": "box"})
POSE = with_rules(**POSED)


def team(base: TaskSpec, count: int, **robot: Any) -> TaskSpec:
    return base.with_updates(team=[{"count": count, "robot": robot}])


def parts(states: Float, n: int) -> tuple[Double, Double, Double]:
    """Robots [..., N, 8], payload [..., 7] and extras of states."""
    wide = states.astype(np.float64)
    first = N_COLUMNS * n
    return (
        robots_of(states, n).astype(np.float64),
        wide[..., first : first + 7],
        wide[..., first + 7 :],
    )


def crowd(step: Step, n: int) -> Double:
    """Commands towards the payload with noise from the state's own bits: many contacts."""
    robots, body, _ = parts(step.states, n)
    wobble = robots[..., : Y + 1] * 1e3 % 1.0 - 0.5
    return 3.0 * (body[:, None, :2] - robots[..., : Y + 1]) + 2.0 * wobble


def play(env: TaskEnv, seeds: Seeds, n_steps: int) -> list[Step]:
    steps = [env.reset(seeds)]
    for _ in range(n_steps):
        steps.append(env.step(crowd(steps[-1], env.spec.n_agents)))
    return steps


# ---- rewards, ends and features, against NumPy


def box_gap(points: Double, body: Double, half: Double) -> Double:
    """Distances of points [N, 2] to a box, [N]."""
    offset, (ux, uy) = points - body[:2], body[4:6]
    local = np.stack([offset @ [ux, uy], offset @ [-uy, ux]], axis=1)
    outside = np.maximum(np.abs(local) - half, 0.0)
    return np.hypot(outside[:, 0], outside[:, 1])


@pytest.mark.parametrize("spec", [DEFAULT, POSE], ids=["disc", "pose"])
def test_features_are_what_the_module_says(spec: TaskSpec) -> None:
    task = Transport(spec)
    states = play(TaskEnv(task, 4), seeds_of(1, 2, 3, 4), 30)[-1].states
    out = np.full((4, 4, len(task.features)), np.nan, dtype=np.float32)
    task.write_features(states, np.zeros((4, 0, 8), np.float32), np.array([1, 1, 0, 1], bool), out)
    robots, bodies, extras = parts(states, 4)
    assert np.isnan(out[2]).all()
    for b in (0, 1, 3):
        body, places = bodies[b], robots[b, :, : Y + 1]
        to_goal = robots[b, 0, TX:] - body[:2]
        named = dict(zip([f.name for f in task.features], out[b].T, strict=True))
        near = np.stack([named["payload_near_x"], named["payload_near_y"]], axis=1)
        np.testing.assert_allclose(out[b, :, :2], body[:2] - places, atol=1e-6)
        np.testing.assert_allclose(
            out[b, :, 4:8], np.tile([*body[2:4], *to_goal], (4, 1)), atol=1e-6
        )
        gaps = np.hypot(*(body[:2] - places).T) - 0.35
        if spec is POSE:
            gaps = box_gap(places, body, np.array([0.35, 0.25]))
            sign = np.sign(body[4:6] @ extras[b])
            last = [*(sign * body[4:6]), body[6] * math.hypot(0.35, 0.25), *extras[b]]
            np.testing.assert_allclose(out[b, :, 12:], np.tile(last, (4, 1)), atol=1e-6)
        np.testing.assert_allclose(np.hypot(*near.T), np.maximum(gaps, 0), atol=1e-6)


def test_robots_feel_the_obstacles_around_the_payload() -> None:
    env = TaskEnv(Transport(DEFAULT), 6)
    step = play(env, seeds_of(*range(6)), 20)[-1]
    names = [feature.name for feature in env.task.features]
    first = len(env.features) - len(names) + names.index("payload_obstacle_0.near_x")
    found = step.observations[:, :, first : first + 4].reshape(6, -1, 2, 2)
    bodies = parts(step.states, 4)[1]
    for b in range(6):
        offsets = [nearest(*map(float, bodies[b, :2]), row) for row in step.layouts[b]]
        expected = []
        for distance, vx, vy in sorted(offsets)[:2]:
            closeness = np.clip(1 - (distance - 0.35) / 1.5, 0, 1)
            expected.append(np.array([vx, vy]) / distance * closeness)
        np.testing.assert_allclose(found[b], np.tile(expected, (4, 1, 1)), atol=1e-5)
    assert (found != 0).any(axis=(1, 2, 3)).all()


def still(spec: TaskSpec) -> tuple[TaskEnv, Step]:
    """A world without physics, to put the payload where a test wants it."""
    env = TaskEnv(Transport(spec), 1, KinematicBackend)
    return env, env.reset(seeds_of(3))


def solved_at(spec: TaskSpec, offset: float, angle: float = 0.0) -> bool:
    env, step = still(spec)
    states = step.states.copy()
    first = N_COLUMNS * spec.n_agents
    states[0, first], states[0, first + 1] = states[0, TX] + offset, states[0, TX + 1]
    if states.shape[1] > first + 7:
        gx, gy = states[0, first + 7 :]
        c, s = math.cos(angle), math.sin(angle)
        states[0, first + 4 : first + 6] = gx * c - gy * s, gx * s + gy * c
    now = step._replace(states=states, reward_terms=np.zeros_like(step.reward_terms))
    solved = np.zeros(1, np.bool_)
    env.task.update(step, now, np.ones(1, np.bool_), solved)
    return bool(solved[0])


def test_it_is_solved_with_the_centre_within_the_goal_radius() -> None:
    assert solved_at(DEFAULT, 0.0)
    assert solved_at(DEFAULT, 0.149)
    assert not solved_at(DEFAULT, 0.151)


@pytest.mark.parametrize("turn", [0.0, math.pi])
def test_with_a_goal_angle_the_axis_must_fit_too_either_way_round(turn: float) -> None:
    assert solved_at(POSE, 0.0, turn)
    assert solved_at(POSE, 0.1, turn + 0.19)
    assert solved_at(POSE, 0.1, turn - 0.19)
    assert not solved_at(POSE, 0.1, turn + 0.21)
    assert not solved_at(POSE, 0.2, turn)
    assert not solved_at(POSE, 0.0, turn + math.pi / 2)


# ---- episodes


def layouts_of(spec: TaskSpec, seeds: Int) -> Iterator[tuple[Float, Float]]:
    task = Transport(spec)
    width = N_COLUMNS * spec.n_agents + len(BODY) + len(task.extras)
    layouts = np.zeros((len(seeds), len(task.kinds), 8), np.float32)
    states = np.full((len(seeds), width), np.nan, np.float32)
    task.spawn(seeds.astype(np.uint64), np.arange(len(seeds)), layouts, states)
    return zip(layouts, states, strict=True)


@pytest.mark.parametrize(
    ("spec", "n_episodes"),
    [
        (DEFAULT, 300),
        (POSE, 100),
        (preset("transport-n3"), 100),
        (preset("transport-n8"), 60),
        (preset("transport-n16"), 30),
        (preset("transport-easy"), 100),
        (preset("transport-hard"), 100),
        (team(BOX, 4, dynamics="unicycle"), 60),
    ],
)
def test_nothing_overlaps_at_the_start_and_the_goal_has_room(
    spec: TaskSpec, n_episodes: int
) -> None:
    rules, s = spec.rules, spec.spawn
    assert isinstance(rules, TransportRules)
    half = np.array([spec.arena.width / 2, spec.arena.height / 2])
    reach, radius = payload_radius(rules.payload), spec.robots[0].radius
    turned = set()
    for layout, state in layouts_of(spec, np.arange(n_episodes)):
        robots, body, extras = parts(state, spec.n_agents)
        assert np.isfinite(state).all()
        goal = robots[0, TX:]
        np.testing.assert_array_equal(robots[:, TX:], np.tile(goal, (spec.n_agents, 1)))
        np.testing.assert_allclose(np.hypot(*body[4:6]), 1.0, atol=1e-6)
        assert not body[[2, 3, 6]].any()
        assert clearance(*body[:2], layout, half) > reach + rules.room - 1e-5
        assert clearance(*goal, layout, half) > reach + s.goal_clearance - 1e-5
        assert np.hypot(*(goal - body[:2])) > s.min_goal_distance - 1e-5
        away = np.hypot(*(robots[:, : Y + 1] - body[:2]).T)
        assert (away > reach + radius + s.start_clearance - 1e-5).all()
        assert (extras.size == 0) or np.hypot(*extras) == pytest.approx(1.0, abs=1e-6)
        turned.add((round(float(body[4]), 2), round(float(robots[0, 4]), 2)))
    assert len(turned) > n_episodes // 4


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ({"payload": {"half_length": 0.9}}, "obstacles.gap is 1.2 m"),
        ({"goal_angle": 0.2}, "goal_angle needs a box"),
        ({"goal_angle": 2.0, "payload": {"shape": "box"}}, "at most pi / 2"),
    ],
)
def test_specs_that_make_no_sense_are_refused(rules: dict[str, Any], words: str) -> None:
    with pytest.raises(SpecError, match=words):
        Transport(with_rules(**rules))


def test_another_tasks_spec_and_too_little_room_are_refused() -> None:
    with pytest.raises(SpecError, match="expected 'transport'"):
        Transport(TaskSpec(rules=NavigationRules()))
    tight = with_rules(room=3.0).with_updates(spawn={"max_attempts": 3})
    with pytest.raises(SpawnError, match="no layout found for seed 5 in 3 attempts"):
        make_env(tight).reset(seeds_of(5))


# ---- physics and metrics


class Push:
    """Drives every robot at the payload."""

    uses_state = True

    def reset(self, step: Step, copies: Int) -> None:
        """Nothing to forget."""

    def act(self, step: Step) -> Float:
        return np.clip(crowd(step, 4), -1, 1).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(crowd(step, 4).astype(np.float64), actions, 0.0)


@pytest.mark.parametrize("spec", [DEFAULT, POSE], ids=["disc", "pose"])
def test_metrics_are_those_of_the_recorded_states(spec: TaskSpec) -> None:
    env = make_env(spec.with_updates(horizon=120), 2)
    for episode in rollout(env, Push(), seeds_of(4, 5)):
        assert env.task.episode_metrics(episode) == pytest.approx(
            expected_metrics(spec, episode), abs=1e-5
        )
        assert set(env.task.metrics) == set(env.task.episode_metrics(episode))


def expected_metrics(spec: TaskSpec, episode: Episode) -> dict[str, float]:
    """By the counts of `payload`, which have tests of their own."""
    shape = shape_of(spec.rules_as(TransportRules).payload)
    robots, bodies, extras = parts(episode.states, 4)
    rows, places = bodies.astype(np.float32), robots[1:, :, : Y + 1].astype(np.float32)
    half, radii = np.array(spec.half_size), np.array([robot.radius for robot in spec.robots])
    cosine = abs(bodies[-1, 4:6] @ extras[-1]) if spec is POSE else 1.0
    return {
        "payload_distance": float(np.hypot(*(robots[-1, 0, TX:] - bodies[-1, :2]))),
        "payload_path": float(np.hypot(*np.diff(bodies[:, :2], axis=0).T).sum()),
        "payload_contacts": count_contacts(rows, shape, episode.layout, half),
        "push_share": count_pushes(places, radii, rows[1:], shape) / (4 * len(episode)),
        "payload_angle": math.acos(min(cosine, 1.0)),
    }
