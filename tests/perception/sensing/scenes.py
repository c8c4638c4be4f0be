"""Random scenes without physics, and the geometry that the NumPy twins share."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.specs.features import Feature, telling_goals
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import BODY, N_COLUMNS, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Step, blank_step

KINDS = (0, 0, 1, 2, 3, 3)
PAYLOADS = (Payload(), Payload(shape="circle", half_length=0.25))


class Still:
    """A task in which nothing moves; its features are each robot's heading and number."""

    kinds = np.array(KINDS)
    extras, metrics = (), SimpleNamespace()

    def __init__(self, spec: TaskSpec, movables: Sequence[Payload], has_features: bool) -> None:
        self.spec, self.movables = spec, tuple(movables)
        vector = telling_goals(
            (Feature("slot_x", "direction", "x"), Feature("slot_y", "direction", "y"))
        )
        self.features = (*vector, Feature("number", "flag")) if has_features else ()

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        robots = robots_of(states, self.spec.n_agents)
        out[active, :, :2] = robots[active, :, 4:6]
        out[active, :, 2] = np.arange(self.spec.n_agents)


def task(
    observation: dict[str, Any],
    n_agents: int = 4,
    has_bodies: bool = False,
    has_features: bool = False,
    **spec: Any,
) -> Task:
    team = spec.pop("team", [{"count": n_agents, "robot": {"dynamics": "unicycle"}}])
    parsed = TaskSpec.parse({"observation": observation, "team": team, **spec})
    return cast(Task, Still(parsed, PAYLOADS if has_bodies else (), has_features))


def step(task: Task, n_copies: int, seed: int, time: int = 0) -> Step:
    """Robots, obstacles and bodies anywhere in the arena, overlapping too."""
    rng, n = np.random.default_rng([seed, time]), task.spec.n_agents
    half = np.array([task.spec.arena.width, task.spec.arena.height]) / 2
    size = N_COLUMNS * n + len(BODY) * len(task.movables)
    states = rng.uniform(-0.5, 0.5, (n_copies, size)).astype(np.float32)
    robots = robots_of(states, n)
    robots[..., :2] = rng.uniform(-0.95, 0.95, (n_copies, n, 2)) * half
    robots[..., 4:6] = directions(rng, (n_copies, n))
    robots[..., 6:] = rng.uniform(-0.95, 0.95, (n_copies, n, 2)) * half
    bodies = states[:, N_COLUMNS * n :].reshape(n_copies, -1, len(BODY))
    bodies[..., :2] = rng.uniform(-0.95, 0.95, bodies[..., :2].shape) * half
    bodies[..., 4:6] = directions(rng, bodies.shape[:2])
    states[:, : N_COLUMNS * n] = robots.reshape(n_copies, -1)
    layouts = np.zeros((n_copies, len(KINDS), 8), dtype=np.float32)
    layouts[..., 0] = KINDS
    layouts[..., 1:3] = rng.uniform(-0.95, 0.95, (n_copies, len(KINDS), 2)) * half
    layouts[..., 3:5] = directions(rng, (n_copies, len(KINDS)))
    layouts[..., 5:7] = rng.uniform(0.15, 0.4, (n_copies, len(KINDS), 2))
    layouts[..., 7] = 0.05
    seeds = np.arange(seed, seed + n_copies, dtype=np.uint64)
    nothing, times = np.zeros((n_copies, n, 0), dtype=np.float32), np.full(n_copies, time)
    return blank_step(nothing, states, seeds=seeds, times=times, layouts=layouts)


def run(task: Task, steps: Sequence[Step], sensor: Sensor | None = None) -> tuple[Float, Float]:
    """Observations [T, E, N, O], and what robots know of themselves [T, E, N, 8].

    Args:
        task: the task.
        steps: of an episode.
        sensor: a fresh one by default.
    """
    n_copies, n = len(steps[0].states), task.spec.n_agents
    sensor = sensor or Sensor(task, n_copies)
    shape = (len(steps), n_copies, n, len(sensor.features))
    out, known = np.full(shape, np.nan, dtype=np.float32), []
    for step, row in zip(steps, out, strict=True):
        own = sensor.observe(step, np.ones(n_copies, dtype=np.bool_), row)
        known.append(robots_of(own, n).copy())
    return out, np.array(known)


def observe(task: Task, step: Step) -> Float:
    """What a fresh sensor observes, [E, N, O]."""
    return run(task, [step])[0][0]


def compare(
    twin: Callable[..., Double],
    model: dict[str, Any],
    robot: dict[str, Any],
    n_agents: int,
    has_bodies: bool,
    seed: int,
) -> None:
    """Checks what a sensor observes in three copies against its twin in NumPy."""
    made = task(model, has_bodies=has_bodies, team=[{"count": n_agents, "robot": robot}])
    seen = step(made, 3, seed)
    out = observe(made, seen)
    for copy in range(3):
        expected = twin(made, seen.states[copy], seen.layouts[copy])
        np.testing.assert_allclose(out[copy], expected, atol=2e-6)


def directions(rng: np.random.Generator, shape: tuple[int, ...]) -> Double:
    angle = rng.uniform(0, 2 * np.pi, shape)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def rows(task: Task, state: Float, layout: Float) -> Double:
    """Obstacles, then movable bodies, as rows of a layout."""
    bodies = state[N_COLUMNS * task.spec.n_agents :].reshape(-1, len(BODY))
    rows = [
        [float(p.shape == "box"), *body[:2], *body[4:6], p.half_length, p.half_width, 0.0]
        for p, body in zip(task.movables, bodies, strict=True)
    ]
    return np.concatenate([layout, np.reshape(rows, (-1, 8))]).astype(np.float64)


def bars(row: Double) -> list[Double]:
    """Corners, counter-clockwise, of the bars of a shape that is no circle, each [4, 2]."""
    a, b, t = row[5:]
    spans = [(-a, a, -b, b)] if row[0] == 1 else [(-a, a, -b, -b + 2 * t)]
    spans += [(-a, -a + 2 * t, -b, b)] if row[0] >= 2 else []
    spans += [(a - 2 * t, a, -b, b)] if row[0] == 3 else []
    turn = np.array([[row[3], row[4]], [-row[4], row[3]]])
    corners = [[(l, b), (r, b), (r, t), (l, t)] for l, r, b, t in spans]  # noqa: E741
    return [np.array(c) @ turn + row[1:3] for c in corners]


def encloses(bar: Double, point: Double) -> bool:
    """Whether a point is in a convex polygon."""
    edge, to = np.roll(bar, -1, axis=0) - bar, point - bar
    return bool((edge[:, 0] * to[:, 1] - edge[:, 1] * to[:, 0] >= 0).all())


def polar(task: Task, robot: Float) -> list[float]:
    """Own velocity in the body's frame, distance to the target, bearing of the target."""
    x, y, vx, vy, ux, uy, tx, ty = robot.astype(np.float64)
    heading, d = complex(ux, uy), complex(tx - x, ty - y)
    v = complex(vx, vy) / heading
    bearing = d / heading / abs(d) if abs(d) >= 0.01 else 0j
    diagonal = np.hypot(task.spec.arena.width, task.spec.arena.height)
    return [v.real, v.imag, min(abs(d) / diagonal, 1.0), bearing.real, bearing.imag]


def cases(most_agents: int = 8, **model: Any) -> st.SearchStrategy[dict[str, Any]]:
    """Arguments of `compare`.

    Args:
        most_agents: of a team.
        model: fields of the observation model, or what draws them.
    """
    drawn = {k: v if isinstance(v, st.SearchStrategy) else st.just(v) for k, v in model.items()}
    robots = st.fixed_dictionaries(
        {
            "dynamics": st.sampled_from(["holonomic", "unicycle"]),
            "sensor_range": st.none() | st.floats(0.1, 3.0),
        }
    )
    return st.fixed_dictionaries(
        {
            "model": st.fixed_dictionaries(drawn),
            "robot": robots,
            "n_agents": st.integers(1, most_agents),
            "has_bodies": st.booleans(),
            "seed": st.integers(0, 2**32),
        }
    )
