"""The world as each robot has measured it: where it believes it is, and what it sees around it.

Noise and losses act here, before any feature exists. Every feature is then the same function of the
measured world as it is of the true one, so none of them can tell what the noise on another hides.

What is measured:

- a robot's own position, velocity and heading. Points that the task gives in the world's frame
  (targets, goals, references, maps) are known exactly; the robot knows how far away they are as
  well as it knows its own position;
- of every other robot, movable body and obstacle: the displacement from the robot, the relative
  velocity, the direction of its axis. In `bearing`, other robots by range and bearing.

Displacements are measured in the world's frame by robots that localise (`state`), in the body's
frame by all others, so that an error of the own heading does not turn them there.

All draws are functions of the episode's seed, the step, the robot that measures and the object that
is measured: the order of slots plays no part.

Draws whose deviation is zero are made too: a branch around each would keep the loops out of vector
registers, which costs four times as much.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.numerics.geometry import bounding_radius
from swarmdata.numerics.random import STREAMS, normal_table
from swarmdata.numerics.random_kernels import absorb, to_normal, to_uniform
from swarmdata.perception.sensing.sensed_scene import N_BODY, Scene
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY, VX, VY, X, Y
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

_SENSOR_STREAM = STREAMS["sensor"]

_OWN, _SEEN, _MISSED = 2, 3, 4
"""Counters after the robot's, of what a draw is for; `modifiers` has 0 and 1."""

_DX, _DY, _DVX, _DVY, _TURN, _TURN_RATE, _RANGE = range(7)
"""Last counter of each draw for one object."""


class Noise(NamedTuple):
    """Standard deviations; see `senses.SensorNoise`."""

    position: float  # m
    velocity: float  # m/s
    direction: float  # rad
    range: float  # m


class Survey(NamedTuple):
    """How robots measure what is around them."""

    n_agents: int
    noise: Noise
    dropout: float  # probability that another robot or an obstacle is missed
    in_body: bool  # displacements and directions are measured in the body's frame
    by_range: bool  # other robots are measured by range and bearing
    arms: Double  # [K] m, from the centre of a movable body to its outermost point


class World(NamedTuple):
    """What a sensor looks at: what was measured, and the truth that decides what is in sight."""

    states: Float  # [E, S] as measured by the robots that look
    layouts: Float  # [E, M, 8] the same
    true_states: Float  # [E, S]
    true_layouts: Float  # [E, M, 8]


class MeasuredWorld:
    """Measures the world for one robot after the other.

    Args:
        task: the task; its spec has the model.
        scene: its constants.
        n_copies: E.
    """

    def __init__(self, task: Task, scene: Scene, n_copies: int) -> None:
        model, n = task.spec.observation, task.spec.n_agents
        self._survey = Survey(
            n_agents=n,
            noise=Noise(**model.noise.model_dump()),
            # beams and cells are lost one by one instead: see `modifiers`
            dropout=model.dropout if model.kind in ("state", "bearing") else 0.0,
            in_body=model.kind != "state",
            by_range=model.kind == "bearing",
            arms=np.array([bounding_radius(_row(body)) for body in scene.bodies], dtype=np.float64),
        )
        size = N_COLUMNS * n + N_BODY * len(scene.bodies) + len(task.extras)
        self._own = np.zeros((n_copies, N_COLUMNS * n), dtype=np.float32)
        self._states = np.zeros((n_copies, size), dtype=np.float32)
        self._layouts = np.zeros((n_copies, len(task.kinds), 8), dtype=np.float32)

    @property
    def is_exact(self) -> bool:
        """Whether what is measured is the truth, and nothing is lost."""
        return self._survey.dropout == 0.0 and not any(self._survey.noise)

    def localise(self, now: Step, active: Bool) -> Float:
        """What each robot of the active copies believes of itself, columns `ROBOT`, [E, 8 N].

        The array is written anew by the next call.
        """
        noise = self._survey.noise
        localise(now.states, now.seeds, now.times, active, noise, normal_table(), self._own)
        return self._own

    def seen_by(self, robot: int, now: Step, active: Bool) -> World:
        """The world as one robot of each active copy measured it; after `localise`.

        Objects that it missed are at NaN. The arrays are written anew by the next call.
        """
        look_around(
            now.states, now.layouts, self._own, robot, self._survey, now.seeds, now.times, active,
            normal_table(), self._states, self._layouts,
        )  # fmt: skip
        return World(self._states, self._layouts, now.states, now.layouts)


def _row(body: Double) -> Double:
    """A movable body [3] of a scene as a row of a layout."""
    return np.array([body[0], 0.0, 0.0, 1.0, 0.0, body[1], body[2], 0.0])


@kernel(inline="always")
def _turn(bits: np.uint64, std: float, table: Double) -> tuple[float, float]:
    """Cosine and sine of a random angle 2 atan(std z / 2), which is std z where that is small.

    The rational parametrisation of the circle: a rotation without a trigonometric function, whose
    bits would depend on the platform.
    """
    half = 0.5 * std * to_normal(absorb(bits, _TURN), table)
    square = half * half
    return (1.0 - square) / (1.0 + square), 2.0 * half / (1.0 + square)


@kernel(inline="always")
def _measurement(seed: np.uint64, time: int, robot: int) -> np.uint64:
    """What all draws of one robot in one step derive from."""
    return absorb(absorb(absorb(seed, _SENSOR_STREAM), time), robot)


@kernel(error_model="numpy")
def localise(
    states: Float, seeds: Seeds, times: Int, active: Bool, noise: Noise, table: Double, own: Float
) -> None:
    """Writes what every robot of the active copies measures of itself.

    Args:
        states: [E, S].
        seeds: of the episodes, [E].
        times: control steps since their reset, [E].
        active: copies to write, [E].
        noise: standard deviations.
        table: quantiles of the normal, as of `seeding.normal_table`.
        own: written, [E, 8 N].
    """
    for b in range(own.shape[0]):
        if not active[b]:
            continue
        for i in range(own.shape[1] // N_COLUMNS):
            at = N_COLUMNS * i
            for c in range(N_COLUMNS):
                own[b, at + c] = states[b, at + c]
            bits = absorb(_measurement(seeds[b], times[b], i), _OWN)
            own[b, at + X] += noise.position * to_normal(absorb(bits, _DX), table)
            own[b, at + Y] += noise.position * to_normal(absorb(bits, _DY), table)
            own[b, at + VX] += noise.velocity * to_normal(absorb(bits, _DVX), table)
            own[b, at + VY] += noise.velocity * to_normal(absorb(bits, _DVY), table)
            c, s = _turn(bits, noise.direction, table)
            ux, uy = np.float64(states[b, at + UX]), np.float64(states[b, at + UY])
            own[b, at + UX], own[b, at + UY] = c * ux - s * uy, s * ux + c * uy


@kernel(inline="always")
def _displacement(
    dx: float, dy: float, bits: np.uint64, noise: Noise, by_range: bool, table: Double
) -> tuple[float, float]:
    """A displacement as measured, by its components or by range and bearing."""
    if by_range:
        distance = math.sqrt(dx * dx + dy * dy)
        measured = max(distance + noise.range * to_normal(absorb(bits, _RANGE), table), 0.0)
        scale = measured / max(distance, 1e-9)
        c, s = _turn(bits, noise.direction, table)
        return (c * dx - s * dy) * scale, (s * dx + c * dy) * scale
    dx += noise.position * to_normal(absorb(bits, _DX), table)
    dy += noise.position * to_normal(absorb(bits, _DY), table)
    return dx, dy


@kernel(inline="always")
def _see_body(
    states: Float,
    own: Float,
    b: int,
    me: int,
    at: int,
    bits: np.uint64,
    noise: Noise,
    by_range: bool,
    heading: tuple[float, float],
    table: Double,
    seen: Float,
) -> None:
    """Writes position, velocity and axis of a robot or movable body as another robot measures them.

    The first six columns of `ROBOT` and of `BODY` are the same.

    Args:
        states: [E, S].
        own: what the robots believe of themselves, [E, 8 N].
        b: the copy.
        me: first column of the robot that measures.
        at: first column of what is measured.
        bits: of the draws for this object.
        noise: standard deviations.
        by_range: whether its position is measured by range and bearing.
        heading: cosine and sine of the error of the own heading; (1, 0) in the world's frame.
        table: quantiles of the normal.
        seen: written, [E, S].
    """
    hc, hs = heading
    dx = np.float64(states[b, at + X]) - np.float64(states[b, me + X])
    dy = np.float64(states[b, at + Y]) - np.float64(states[b, me + Y])
    dx, dy = _displacement(dx, dy, bits, noise, by_range, table)
    seen[b, at + X] = np.float64(own[b, me + X]) + (hc * dx - hs * dy)
    seen[b, at + Y] = np.float64(own[b, me + Y]) + (hs * dx + hc * dy)
    dvx = np.float64(states[b, at + VX]) - np.float64(states[b, me + VX])
    dvy = np.float64(states[b, at + VY]) - np.float64(states[b, me + VY])
    dvx += noise.velocity * to_normal(absorb(bits, _DVX), table)
    dvy += noise.velocity * to_normal(absorb(bits, _DVY), table)
    seen[b, at + VX] = np.float64(own[b, me + VX]) + (hc * dvx - hs * dvy)
    seen[b, at + VY] = np.float64(own[b, me + VY]) + (hs * dvx + hc * dvy)
    c, s = _turn(bits, noise.direction, table)
    ux = np.float64(states[b, at + UX]) * hc - np.float64(states[b, at + UY]) * hs
    uy = np.float64(states[b, at + UX]) * hs + np.float64(states[b, at + UY]) * hc
    seen[b, at + UX], seen[b, at + UY] = c * ux - s * uy, s * ux + c * uy


@kernel(inline="always")
def _see_obstacle(
    states: Float,
    layouts: Float,
    own: Float,
    b: int,
    me: int,
    m: int,
    bits: np.uint64,
    noise: Noise,
    heading: tuple[float, float],
    table: Double,
    seen: Float,
) -> None:
    """Writes row m of a layout as a robot measures it, seen [E, M, 8]; see `_see_body`."""
    hc, hs = heading
    dx = np.float64(layouts[b, m, 1]) - np.float64(states[b, me + X])
    dy = np.float64(layouts[b, m, 2]) - np.float64(states[b, me + Y])
    dx, dy = _displacement(dx, dy, bits, noise, False, table)
    c, s = _turn(bits, noise.direction, table)
    ux = np.float64(layouts[b, m, 3]) * hc - np.float64(layouts[b, m, 4]) * hs
    uy = np.float64(layouts[b, m, 3]) * hs + np.float64(layouts[b, m, 4]) * hc
    seen[b, m, 0] = layouts[b, m, 0]
    seen[b, m, 1] = np.float64(own[b, me + X]) + (hc * dx - hs * dy)
    seen[b, m, 2] = np.float64(own[b, me + Y]) + (hs * dx + hc * dy)
    seen[b, m, 3], seen[b, m, 4] = c * ux - s * uy, s * ux + c * uy
    for k in range(5, 8):
        seen[b, m, k] = layouts[b, m, k]


@kernel(inline="always")
def _miss(
    seen: Float,
    layouts: Float,
    b: int,
    i: int,
    n: int,
    first: int,
    chance: np.uint64,
    dropout: float,
) -> None:
    """Puts what robot i misses at NaN: other robots, and obstacles, counted from `first` on."""
    for j in range(n):
        if j != i and to_uniform(absorb(chance, j)) < dropout:
            seen[b, N_COLUMNS * j + X], seen[b, N_COLUMNS * j + Y] = np.nan, np.nan
    for m in range(layouts.shape[1]):
        if to_uniform(absorb(chance, first + m)) < dropout:
            layouts[b, m, 1], layouts[b, m, 2] = np.nan, np.nan


@kernel(error_model="numpy")
def look_around(
    states: Float,
    layouts: Float,
    own: Float,
    i: int,
    survey: Survey,
    seeds: Seeds,
    times: Int,
    active: Bool,
    table: Double,
    seen: Float,
    seen_layouts: Float,
) -> None:
    """Writes the world as robot i of every active copy measures it.

    An object's measured position is the robot's own plus the measured displacement.

    Args:
        states: [E, S].
        layouts: [E, M, 8].
        own: what the robots believe of themselves, as of `localise`, [E, 8 N].
        i: the robot that measures.
        survey: how it measures.
        seeds: of the episodes, [E].
        times: control steps since their reset, [E].
        active: copies to write, [E].
        table: quantiles of the normal, as of `seeding.normal_table`.
        seen: states, written, [E, S].
        seen_layouts: written, [E, M, 8].
    """
    n, noise, arms, me = survey.n_agents, survey.noise, survey.arms, N_COLUMNS * i
    first = n + arms.shape[0]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        measurement = _measurement(seeds[b], times[b], i)
        sight, heading = absorb(measurement, _SEEN), (1.0, 0.0)
        if survey.in_body:
            heading = _turn(absorb(measurement, _OWN), noise.direction, table)
        seen[b] = states[b]
        seen[b, me : me + N_COLUMNS] = own[b, me : me + N_COLUMNS]
        for j in range(first):
            bits, is_robot = absorb(sight, j), j < n
            at = N_COLUMNS * j if is_robot else N_COLUMNS * n + N_BODY * (j - n)
            by_range = survey.by_range and is_robot
            if j != i:
                _see_body(states, own, b, me, at, bits, noise, by_range, heading, table, seen)
            if not is_robot:
                rate = noise.velocity / arms[j - n]
                seen[b, at + N_BODY - 1] += rate * to_normal(absorb(bits, _TURN_RATE), table)
        for m in range(layouts.shape[1]):
            bits = absorb(sight, first + m)
            _see_obstacle(states, layouts, own, b, me, m, bits, noise, heading, table, seen_layouts)
        if survey.dropout > 0.0:
            chance = absorb(measurement, _MISSED)
            _miss(seen, seen_layouts, b, i, n, first, chance, survey.dropout)
