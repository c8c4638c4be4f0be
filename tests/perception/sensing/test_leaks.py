"""No column tells what the noise on another hides: regressions that try to find out.

The regressions are linear in the features and in what geometry suggests to make of them: lengths
and directions of vectors, and a direction times the distance that stands beside it. They undo every
nonlinear function of a displacement that a sensor computes. Whatever they learn, their error on
fresh samples must not be much smaller than that of the measurement itself; two independent
measurements of one quantity, one's own and a received one, may be averaged.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.features import Feature, vector
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Step
from tests.perception.sensing import scenes
from tests.support.pairs import once_each, pairwise

STD = 0.2
NOISE = {"position": STD, "velocity": STD, "direction": STD, "range": STD}
N_SAMPLES = 3000
ALONE, FUSED = 0.9, 0.75
"""Least error, in that of one measurement, with room for chance: 1, or sqrt(2 / 3) for the mean of
one's own and one of two own ones that was received."""


def observe(task: Task, steps: list[Step]) -> Float:
    """What robot 0 of each copy observes in the last of some steps, [E, O]."""
    n_copies, n = len(steps[0].states), task.spec.n_agents
    observer = Observer(task, n_copies)
    observations, sent, delivered, ages = observer.allocate((n_copies,), n)
    active = np.ones(n_copies, dtype=np.bool_)
    for time, step in enumerate(steps):
        now = step._replace(
            observations=observations,
            sent=sent,
            delivered=delivered,
            ages=ages,
            times=np.full(n_copies, time),
        )
        observer.observe(now, None, active, np.arange(n_copies) if time == 0 else None)
    return observations[:, 0].copy()


def basis(features: tuple[Feature, ...], observations: Float | Double) -> Double:
    """The features and what geometry suggests to make of them, [E, K]."""
    values = observations.astype(np.float64)
    columns = [np.ones(len(values)), *values.T]
    for k, feature in enumerate(features):
        if feature.axis != "x":
            continue
        x, y = values[:, k], values[:, k + 1]
        length = np.hypot(x, y)
        unit = np.where(length > 0, (x, y) / np.maximum(length, 1e-9), 0.0)
        columns += [length, *unit]
        for softness in (0.1, 0.3, 1.0):  # the best guess of a direction shrinks within the noise
            columns += [x / np.hypot(length, softness), y / np.hypot(length, softness)]
        for j, other in enumerate(features):
            if other.kind == "range" and _owner(other) == _owner(feature):
                columns += [values[:, j] * x, values[:, j] * y, values[:, j] * unit[0]]
    return np.stack(columns, axis=1)


def _owner(feature: Feature) -> str:
    return feature.name.rpartition(".")[0]


def errors_of(columns: Double, hidden: Mapping[str, Double]) -> dict[str, float]:
    """Root mean square errors of a component on fresh samples, of the best linear guesses.

    All vectors [E, 2] are guessed at once: decomposing the columns takes most of the time.
    """
    cut, values = 2 * len(columns) // 3, np.stack(list(hidden.values()))  # [V, E, 2]
    wanted = values.transpose(1, 0, 2).reshape(len(columns), -1)
    scaled = columns / np.maximum(np.abs(columns).max(axis=0), 1e-9)
    weights, *_ = np.linalg.lstsq(scaled[:cut], wanted[:cut], rcond=1e-10)
    squares = (scaled[cut:] @ weights - wanted[cut:]) ** 2
    found = np.sqrt(squares.reshape(-1, len(hidden), 2).mean(axis=(0, 2)))
    return dict(zip(hidden, found.tolist(), strict=True))


def error_of(columns: Double, hidden: Double) -> float:
    """The same of one vector."""
    return errors_of(columns, {"": hidden})[""]


def spread(hidden: Double) -> float:
    """Root mean square error of who knows nothing."""
    return float(np.sqrt(hidden.var(axis=0).mean()))


def hidden_of(step: Step) -> dict[str, Double]:
    """What robot 0's sensors measure with noise: displacements [E, 2] and velocities [E, 2]."""
    robot, other = (step.states[:, N_COLUMNS * i :].astype(np.float64) for i in range(2))
    return {
        "own position": robot[:, :2],
        "own velocity": robot[:, 2:4],
        "target": robot[:, 6:8] - robot[:, :2],
        "neighbor": other[:, :2] - robot[:, :2],
        "neighbor's velocity": other[:, 2:4] - robot[:, 2:4],
        "obstacle": step.layouts[:, 0, 1:3].astype(np.float64) - robot[:, :2],
    }


def directions_of(displacements: Double) -> Double:
    lengths = np.linalg.norm(displacements, axis=1, keepdims=True)
    return displacements / np.maximum(lengths, 1e-9)


def make_step(task: Task, seed: int, time: int = 0, *, is_near: bool = False) -> Step:
    """Two robots and one obstacle; target and neighbour are 0.8 to 3 m away, or 0.1 to 0.5 m."""
    step: Step = scenes.step(task, N_SAMPLES, seed, time)
    step = step._replace(layouts=step.layouts[:, :1].copy())
    for at in (2, 3, N_COLUMNS + 2, N_COLUMNS + 3):  # fast, so that noise matters, not the prior
        step.states[:, at] *= 5
    rng = np.random.default_rng([seed, time])
    for at in (6, N_COLUMNS):
        distances = rng.uniform(*((0.1, 0.5) if is_near else (0.8, 3.0)), (N_SAMPLES, 1))
        offsets = distances * scenes.directions(rng, (N_SAMPLES,))
        step.states[:, at : at + 2] = step.states[:, :2] + offsets
    return step


MODIFIERS: dict[str, dict[str, Any]] = {
    "noise": {"noise": NOISE},
    "noise and delay": {"noise": NOISE, "delay": 1},
    "noise and losses": {"noise": NOISE, "dropout": 0.2},
}
RADIOS: dict[str, dict[str, Any]] = {
    "silent": {"kind": "none"},
    "pose": {"kind": "broadcast", "payload": "pose_and_goal"},
    "state": {"kind": "broadcast", "payload": "state"},
    "quantised": {"kind": "broadcast", "payload": "state", "bits": 12},
}


@pytest.mark.parametrize(
    ("kind", "modifiers", "radio"),
    pairwise(("state", "lidar", "bearing", "occupancy"), tuple(MODIFIERS), tuple(RADIOS)),
)
def test_noise_hides_what_it_is_added_to(kind: str, modifiers: str, radio: str) -> None:
    model = {"kind": kind, **MODIFIERS[modifiers]}
    task = scenes.task(model, n_agents=2, communication=RADIOS[radio])
    for is_near in (False, True):
        step = make_step(task, seed=1, is_near=is_near)
        still = [step] * (1 + task.spec.observation.delay)  # nothing moves: old frames are current
        columns = basis(Observer(task, 1).features, observe(task, still))
        hidden = hidden_of(step)
        if is_near:  # who knows that the target is near knows from it where it is itself
            hidden = {name: hidden[name] for name in ("target", "neighbor")}
        wanted = {
            **hidden,
            **{f"direction of {name}": directions_of(hidden[name]) for name in hidden},
        }
        errors = errors_of(columns, wanted)
        for name, value in hidden.items():
            measured = measure(value, by_range=kind == "bearing" and name == "neighbor")
            honest = basis(vector("measured", "position"), measured)
            both = {key: wanted[key] for key in (name, f"direction of {name}")}
            for key, allowed in errors_of(honest, both).items():
                least = ALONE if radio == "silent" else FUSED
                assert errors[key] > least * allowed, (key, is_near, errors[key], allowed)


def measure(value: Double, by_range: bool) -> Double:
    """Adds the noise of one measurement to vectors [E, 2]."""
    rng = np.random.default_rng(0)
    if not by_range:
        return value + STD * rng.standard_normal(value.shape)
    across = value[:, ::-1] * [-1, 1]
    draws = STD * rng.standard_normal((2, len(value), 1))
    return value + draws[0] * directions_of(value) + draws[1] * across


@pytest.mark.parametrize("kind", ["state", "lidar", "bearing", "occupancy"])
def test_delay_hides_the_present(kind: str) -> None:
    """Each step is another world, so that nothing old tells of the present; messages neither."""
    radio = {"kind": "broadcast", "payload": "state"}
    task = scenes.task({"kind": kind, "delay": 2}, n_agents=2, communication=radio)
    steps = [make_step(task, seed, time) for time, seed in enumerate((1, 2, 3, 4))]
    columns = basis(Observer(task, 1).features, observe(task, steps))
    hidden = hidden_of(steps[-1])
    for name, error in errors_of(columns, hidden).items():
        assert error > 0.95 * spread(hidden[name]), name


@pytest.mark.parametrize("kind", ["state", "bearing"])
def test_what_is_missed_is_hidden(kind: str) -> None:
    task = scenes.task({"kind": kind, "dropout": 0.5}, n_agents=2)
    step = make_step(task, seed=1)
    features, seen = Observer(task, 1).features, observe(task, [step])
    (mask,) = [k for k, feature in enumerate(features) if feature.name == "neighbor_0.mask"]
    missed = seen[:, mask] == 0
    hidden = hidden_of(step)["neighbor"][missed]
    errors = error_of(basis(features, seen)[missed], hidden)
    assert errors > 0.95 * spread(hidden)


def test_quantisation_hides_what_is_within_a_cell() -> None:
    radio = {"kind": "broadcast", "payload": "pose", "bits": 3}
    task = scenes.task({"kind": "state", "n_neighbors": 0}, n_agents=2, communication=radio)
    step = make_step(task, seed=1)
    columns = basis(Observer(task, 1).features, observe(task, [step]))
    cell = np.array([task.spec.arena.width, task.spec.arena.height]) / 8
    errors = error_of(columns, hidden_of(step)["neighbor"])
    assert errors > 0.9 * np.sqrt((cell**2).mean() / 12)


@pytest.mark.parametrize(
    ("name", "kind"),
    once_each(
        # not intersection: who knows at which gate a robot starts knows where it is
        ("coop_nav", "coop_nav-unassigned", "formation", "transport", "warehouse", "search",
         "pursuit"),
        ("state", "bearing"),
    ),
)  # fmt: skip
def test_what_a_task_adds_hides_it_too(name: str, kind: str) -> None:
    """References, goals, payloads and the way through aisles, seen by robots that see no walls."""
    blind = {"kind": kind, "n_neighbors": 0, "noise": NOISE}
    if kind == "state":
        blind["n_obstacles"] = 0
    spec = TaskSpec.parse({**preset(name).model_dump(mode="json"), "observation": blind})
    env = make_env(spec, 250)
    step = env.reset(np.arange(250, dtype=np.uint64))
    n = env.spec.n_agents
    columns = basis(env.features, step.observations.reshape(250 * n, -1))
    robots = step.states[:, : N_COLUMNS * n].reshape(250 * n, N_COLUMNS).astype(np.float64)
    hidden = {"own position": robots[:, :2], "target": robots[:, 6:] - robots[:, :2]}
    if env.task.movables:
        body = step.states[:, N_COLUMNS * n :][:, :2].astype(np.float64)
        hidden["payload"] = np.repeat(body, n, axis=0) - robots[:, :2]
    for what, error in errors_of(columns, hidden).items():
        assert error > ALONE * STD, what


@pytest.mark.parametrize("error", ["noise-0.2", "drift-0.2"])
@pytest.mark.parametrize("name", ["pursuit-sight", "tag"])
def test_a_target_where_the_robot_is_does_not_tell_where(name: str, error: str) -> None:
    """Of a robot that knows no evader, and of one that is the evader: they are the last."""
    env = make_env(preset(name).with_updates(observation=f"=state+{error}"), 50)
    step = env.reset(np.arange(50, dtype=np.uint64))
    for _ in range(5):
        step = env.step(np.full((50, env.spec.n_agents, env.action_size), 0.3))
    names, seen = [feature.name for feature in env.features], step.observations[:, -1]
    x, to_goal = (seen[:, names.index(name)] for name in ("own.x", "own.goal_dx"))
    at = N_COLUMNS * (env.spec.n_agents - 1)
    stays = step.states[:, at] == step.states[:, at + 6]
    assert stays.any()
    assert np.abs(x - step.states[:, at])[stays].min() > 0
    assert not to_goal[stays].any()


def test_a_target_that_is_seen_does_not_tell_where_the_robot_is_that_drifts() -> None:
    """Of a pursuer, whose target is the evader, and a slot of whose observation shows it."""
    env = make_env(preset("tag").with_updates(observation="=state+drift-0.2"), 50)
    step = env.reset(np.arange(50, dtype=np.uint64))
    for _ in range(5):
        step = env.step(np.full((50, env.spec.n_agents, env.action_size), 0.3))
    names, seen = [feature.name for feature in env.features], step.observations[:, 0]
    at = N_COLUMNS * (env.spec.n_agents - 1)
    for axis, own in (("x", 0), ("y", 1)):
        true, evader = step.states[:, own], step.states[:, at + own]
        drift = seen[:, names.index(f"own.{axis}")] - true
        to_goal = seen[:, names.index(f"own.goal_d{axis}")]
        assert np.abs(drift).min() > 0
        np.testing.assert_allclose(to_goal, evader - true, atol=1e-5)
