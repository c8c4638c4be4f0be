"""Drift: robots see the world as from the pose they believe in, and nothing tells the true one."""

from typing import Any

import numpy as np
import pytest

from swarmdata.interfaces import Task
from swarmdata.numerics.random import STREAMS, derive, normal
from swarmdata.perception.observer import Observer
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, robots_of
from swarmdata.types import Double, Step
from tests.perception.sensing import scenes
from tests.perception.sensing.test_leaks import ALONE, FUSED, basis, error_of, make_step, spread
from tests.perception.sensing.test_leaks import observe as observe_robot_0

KINDS = ("state", "lidar", "bearing", "occupancy")
FAST = {"position": 0.1, "heading": 0.2, "turning": 0.3}
TEAM = [
    {"name": "a", "count": 1, "robot": {"dynamics": "unicycle"}},
    {"name": "b", "count": 2, "robot": {}},
]
BODY_FRAME = {"kind": "state", "frame": "body"}
WIDE = {"width": 40.0, "height": 40.0}


def path(task: Task, n_copies: int = 2, n_steps: int = 5, seed: int = 3) -> list[Step]:
    """Robots that are somewhere else, and turned, in each step; holonomic ones are never turned."""
    steps = [scenes.step(task, n_copies, seed, time) for time in range(n_steps)]
    turns = [robot.dynamics == "unicycle" for robot in task.spec.robots]
    for step in steps:
        robots = robots_of(step.states, task.spec.n_agents).copy()
        robots[:, ~np.array(turns), 4:6] = 1.0, 0.0
        step.states[:, : N_COLUMNS * task.spec.n_agents] = robots.reshape(n_copies, -1)
    return [step._replace(layouts=steps[0].layouts, seeds=steps[0].seeds) for step in steps]


def reckoned(task: Task, steps: list[Step], copy: int, i: int) -> tuple[Double, Double]:
    """Believed positions and the errors of headings of a robot, complex [T]; plain NumPy."""
    model, robot = task.spec.observation, task.spec.robots[i]
    p, h, t = model.drift.position, model.drift.heading, model.drift.turning
    rows = np.array([robots_of(step.states, task.spec.n_agents)[copy, i] for step in steps], float)
    at, headings = rows[:, 0] + 1j * rows[:, 1], rows[:, 4] + 1j * rows[:, 5]
    width, height = task.spec.half_size
    marks = [0j, *(complex(x, y) for x in (-width, width) for y in (-height, height))]
    bits = derive(steps[0].seeds[copy], STREAMS["odometry"], i)
    bias = [float(normal(derive(bits, 0, k))[0]) for k in range(3)]
    believed, errors = [at[0]], [1 + 0j]
    for now in range(1, len(steps)):
        walk = [float(normal(derive(bits, now + 1, k))[0]) for k in range(3)]
        move = at[now] - at[now - 1]
        turn = (headings[now] * np.conj(headings[now - 1])).imag
        step = (1 + p * bias[0]) * errors[-1] * move
        step += p * np.sqrt(abs(move)) * complex(walk[0], walk[1])
        angle = h * bias[1] * abs(move) + t * bias[2] * turn
        angle += np.sqrt(h * h * abs(move) + t * t * abs(turn)) * walk[2]
        error = errors[-1]
        if robot.dynamics == "unicycle":
            error *= complex(1, angle / 2) / complex(1, -angle / 2)
        reach = model.landmarks
        if reach is not None and min(abs(at[now] - mark) for mark in marks) <= reach:
            believed, errors = [*believed, at[now]], [*errors, 1 + 0j]
        else:
            believed, errors = [*believed, believed[-1] + step], [*errors, error]
    return np.array(believed), np.array(errors)


@pytest.mark.parametrize("landmarks", [None, 1.2])
@pytest.mark.parametrize("kind", KINDS)
def test_what_robots_know_of_themselves_equals_a_numpy_twin(
    kind: str, landmarks: float | None
) -> None:
    task = scenes.task({"kind": kind, "drift": FAST, "landmarks": landmarks}, team=TEAM)
    steps = path(task, n_steps=8)
    _, known = scenes.run(task, steps)
    resets = 0
    for copy in range(2):
        for i in range(3):
            believed, errors = reckoned(task, steps, copy, i)
            true = np.array([robots_of(step.states, 3)[copy, i] for step in steps])
            own = known[:, copy, i]
            np.testing.assert_allclose(own[:, 0] + 1j * own[:, 1], believed, atol=1e-5)
            for c in (2, 4):
                turned = errors * (true[:, c] + 1j * true[:, c + 1])
                np.testing.assert_allclose(own[:, c] + 1j * own[:, c + 1], turned, atol=1e-5)
            np.testing.assert_array_equal(own[:, TX : TY + 1], true[:, TX : TY + 1])
            resets += int((believed[1:] == true[1:, 0] + 1j * true[1:, 1]).sum())
    assert (resets > 0) == (landmarks is not None)


def moved_world(task: Task, step: Step, i: int, believed: complex, error: complex) -> Step:
    """The world moved and turned so that robot i is where it believed to be; targets stay."""
    n, first = task.spec.n_agents, N_COLUMNS * task.spec.n_agents
    states, layouts = step.states[:1].astype(float), step.layouts[:1].astype(float)
    own = complex(*states[0, N_COLUMNS * i :][:2])

    def place(rows: Double, x: int) -> None:
        moved = believed + error * (rows[..., x] + 1j * rows[..., x + 1] - own)
        rows[..., x], rows[..., x + 1] = moved.real, moved.imag

    def direction(rows: Double, x: int) -> None:
        turned = error * (rows[..., x] + 1j * rows[..., x + 1])
        rows[..., x], rows[..., x + 1] = turned.real, turned.imag

    for rows in (states[:, :first].reshape(n, -1), states[:, first:].reshape(-1, len(BODY))):
        place(rows, 0)
        direction(rows, 2)
        direction(rows, 4)
    place(layouts, 1)
    direction(layouts, 3)
    return step._replace(
        states=states.astype(np.float32),
        layouts=layouts.astype(np.float32),
        seeds=step.seeds[:1],
        times=step.times[:1],
    )


@pytest.mark.parametrize("model", [*({"kind": kind} for kind in KINDS), BODY_FRAME])
def test_robots_observe_the_world_as_from_where_they_believe_to_be(model: dict[str, Any]) -> None:
    """So an observation does not change where only what is hidden does: the true pose."""
    options: dict[str, Any] = {
        "team": TEAM,
        "has_bodies": True,
        "has_features": True,
        "arena": WIDE,
    }
    drifting = scenes.task({**model, "drift": FAST}, **options)
    exact = scenes.task(model, **options)
    steps = path(drifting, n_copies=1)
    for step in steps:  # near each other, far from walls
        step.states[:, [0, 1, 8, 9, 16, 17, 24, 25, 31, 32]] *= 0.1
    found, _ = scenes.run(drifting, steps)
    for i in range(3):
        believed, errors = reckoned(drifting, steps, 0, i)
        world = moved_world(drifting, steps[-1], i, believed[-1], errors[-1])
        expected, _ = scenes.run(exact, [world])
        close = np.isclose(found[-1, 0, i], expected[0, 0, i], atol=1e-4)
        assert close.mean() > 0.98  # the edge of a cell may fall either way
        plain, _ = scenes.run(exact, steps)
        assert not np.allclose(found[-1, 0, i], plain[-1, 0, i], atol=1e-3)


@pytest.mark.parametrize("kind", ["lidar", "bearing", "occupancy"])
def test_what_is_measured_from_the_body_does_not_drift(kind: str) -> None:
    """Beams, bearings and cells, walls too; only the target does."""
    drifting = scenes.task({"kind": kind, "drift": FAST}, has_bodies=True)
    exact = scenes.task({"kind": kind}, has_bodies=True)
    steps = path(drifting)
    with_drift, without = scenes.run(drifting, steps)[0][-1], scenes.run(exact, steps)[0][-1]
    is_target = np.array([f.name.startswith("target") for f in Sensor(exact, 1).features])
    close = np.isclose(with_drift, without, atol=1e-5)
    assert close[..., ~is_target].mean() > 0.995  # the edge of a cell
    assert not close[..., is_target].all(-1).any()


@pytest.mark.parametrize("radio", [{"kind": "none"}, {"kind": "broadcast", "payload": "state"}])
@pytest.mark.parametrize("kind", ["state", "bearing"])
def test_drift_hides_the_own_position(kind: str, radio: dict[str, str]) -> None:
    """Regressions on observations and messages do no better than the reckoned position itself.

    Hearing another robot's estimate, and seeing where that robot is, gives one more estimate.
    """
    model = {"kind": kind, "drift": {"position": 0.3}}
    task = scenes.task(model, n_agents=2, communication=radio)
    steps = [make_step(task, seed, time) for time, seed in enumerate((1, 2, 3))]
    steps = [step._replace(seeds=steps[0].seeds) for step in steps]
    for step in steps[:-1]:  # so that every step is about as long
        step.states[:, [0, 1, 8, 9]] *= 0.1
    columns = basis(Observer(task, 1).features, observe_robot_0(task, steps))
    position = steps[-1].states[:, :2].astype(np.float64)
    _, known = scenes.run(task, steps)
    reckoning = spread(known[-1, :, 0, :2] - position)
    assert reckoning > 0.3
    honest = error_of(np.column_stack([np.ones(len(position)), known[-1, :, 0, :2]]), position)
    least = ALONE if radio["kind"] == "none" else FUSED
    assert error_of(columns, position) > least * honest
