"""The world as each robot measures it: its own pose, and the objects around it.

Every feature is the same function of the measured world as of the true one, so that none reveals
what the noise on another hides. Measured are a robot's own position, velocity and heading, and the
displacement, relative velocity and axis of every other object, in `bearing` by range and bearing.
Draws whose deviation is zero are made too: branches would keep loops from being vectorised.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.numerics.episode_draws import NOISE_FIELD, draw_share
from swarmdata.numerics.geometry import bounding_radius
from swarmdata.numerics.random import STREAMS, normal_table
from swarmdata.numerics.random_kernels import absorb, to_normal, to_uniform
from swarmdata.perception.sensing.odometry import Odometry
from swarmdata.perception.sensing.sensed_scene import N_BODY, Scene
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

_SENSOR_STREAM = STREAMS["sensor"]

_OF_ITSELF, _OF_OBJECTS, _OF_LOSSES = 2, 3, 4
"""Counters after the robot's: the purpose of a draw. `modifiers` has 0 and 1."""

_DX, _DY, _DVX, _DVY, _TURN, _TURN_RATE, _RANGE = range(7)
"""Last counter of each draw for one object."""


class Noise(NamedTuple):
    """Standard deviations; see `sensing_models.SensorNoise`."""

    position: float  # m
    velocity: float  # m/s
    direction: float  # rad
    range: float  # m


class Survey(NamedTuple):
    """How robots measure the objects around them."""

    n_agents: int
    noise: Noise
    spread: float  # of the deviations that an episode draws: the largest minus `noise`
    dropout: float  # probability that another robot or an obstacle is missed
    in_body: bool  # displacements and directions are measured in the body's frame
    by_range: bool  # other robots are measured by range and bearing
    arms: Double  # [K] m, from the centre of a movable body to its outermost point


class World(NamedTuple):
    """The input of a sensor: the measured world, and the true one that decides visibility."""

    states: Float  # [E, S] as measured by the robots that observe
    layouts: Float  # [E, M, 8] as measured
    true_states: Float  # [E, S]
    true_layouts: Float  # [E, M, 8]
    poses: Float  # [E, >= 8 N] robots as measured, without drift: where walls are seen from


class Sense(NamedTuple):
    """One kind of observation model in one scene."""

    features: tuple[Feature, ...]
    echoes: Int  # first feature of each beam or cell, and one past its last, [R, 2]
    sense: Callable[[World, range, Bool, Float], None]
    """Writes `features` of some robots of the active copies, [E, N, F]."""


class MeasuredWorld:
    """Measures the world for one robot after the other."""

    def __init__(self, task: Task, scene: Scene, n_copies: int) -> None:
        model, n = task.spec.observation, task.spec.n_agents
        noise, spread = _noise_range(task.spec)
        self._survey = Survey(
            n_agents=n,
            noise=noise,
            spread=spread,
            # beams and cells are lost one by one instead: see `modifiers`
            dropout=model.dropout if model.kind in ("state", "bearing") else 0.0,
            in_body=model.in_body_frame,
            by_range=model.kind == "bearing",
            arms=np.array([bounding_radius(_row(body)) for body in scene.bodies], dtype=np.float64),
        )
        size = N_COLUMNS * n + N_BODY * len(scene.bodies) + len(task.extras)
        self._odometry = Odometry(task.spec, n_copies)
        self._known = np.zeros((n_copies, N_COLUMNS * n), dtype=np.float32)
        self._poses = self._known if self._odometry.is_exact else self._known.copy()
        self._states = np.zeros((n_copies, size), dtype=np.float32)
        self._layouts = np.zeros((n_copies, len(task.kinds), 8), dtype=np.float32)

    @property
    def is_exact(self) -> bool:
        """Whether all measurements are exact, and nothing is lost."""
        survey = self._survey
        has_noise = survey.spread > 0.0 or any(survey.noise)
        return survey.dropout == 0.0 and not has_noise and self._odometry.is_exact

    def forget(self, copies: Int) -> None:
        self._odometry.forget(copies)

    def localise(self, step: Step, active: Bool) -> Float:
        """Returns what the active copies' robots measure of themselves, columns `ROBOT`, [E, 8 N].

        Call it once for every step of an episode. The next call overwrites the array.
        """
        localise(
            step.states, step.seeds, step.times, active, self._survey, normal_table(), self._known
        )  # fmt: skip
        if not self._odometry.is_exact:
            np.copyto(self._poses, self._known)
            self._odometry.advance(step, active, self._known)
        stay_on_target(step.states, active, self._known)
        return self._known

    def measured_by(self, robot: int, step: Step, active: Bool) -> World:
        """Returns the world as one robot of each active copy measured it; call `localise` first.

        Objects that it missed are at NaN. The next call overwrites the arrays.
        """
        look_around(
            step.states, step.layouts, self._known, self._odometry.errors, robot, self._survey,
            step.seeds, step.times, active, normal_table(), self._states, self._layouts,
        )  # fmt: skip
        return World(self._states, self._layouts, step.states, step.layouts, self._poses)


def _noise_range(spec: TaskSpec) -> tuple[Noise, float]:
    """The smallest deviations of an episode, and how much larger they may be."""
    drawn = spec.randomization.noise
    if drawn is None:
        return Noise(**spec.observation.noise.model_dump()), 0.0
    return Noise(*(drawn[0],) * 4), drawn[1] - drawn[0]


@kernel(inline="always")
def _noise_of(seed: np.uint64, robot: int, survey: Survey) -> Noise:
    more, least = survey.spread * draw_share(seed, NOISE_FIELD, robot), survey.noise
    return Noise(
        least.position + more, least.velocity + more, least.direction + more, least.range + more
    )


def _row(body: Double) -> Double:
    """Returns a movable body [3] of a scene as a row of a layout."""
    return np.array([body[0], 0.0, 0.0, 1.0, 0.0, body[1], body[2], 0.0])


@kernel(inline="always")
def _turn(bits: np.uint64, std: float, table: Double) -> tuple[float, float]:
    """Cosine and sine of a random angle 2 atan(std z / 2), about std z; rational, for its bits."""
    half = 0.5 * std * to_normal(absorb(bits, _TURN), table)
    square = half * half
    return (1.0 - square) / (1.0 + square), 2.0 * half / (1.0 + square)


@kernel(inline="always")
def _measurement(seed: np.uint64, time: int, robot: int) -> np.uint64:
    """The counter from which all draws of one robot in one step derive."""
    return absorb(absorb(absorb(seed, _SENSOR_STREAM), time), robot)


@kernel(error_model="numpy")
def localise(
    states: Float,  # [E, S]
    seeds: Seeds,  # [E] of the episodes
    times: Int,  # [E] control steps since their reset
    active: Bool,  # [E] copies to write
    survey: Survey,  # how they measure
    table: Double,  # quantiles of the normal distribution, from `random.normal_table`
    known: Float,  # [E, 8 N] written
) -> None:
    """Writes the measurements of every robot of the active copies of itself."""
    for b in range(known.shape[0]):
        if not active[b]:
            continue
        for i in range(known.shape[1] // N_COLUMNS):
            at, noise = N_COLUMNS * i, _noise_of(seeds[b], i, survey)
            for c in range(N_COLUMNS):
                known[b, at + c] = states[b, at + c]
            bits = absorb(_measurement(seeds[b], times[b], i), _OF_ITSELF)
            known[b, at + X] += noise.position * to_normal(absorb(bits, _DX), table)
            known[b, at + Y] += noise.position * to_normal(absorb(bits, _DY), table)
            known[b, at + VX] += noise.velocity * to_normal(absorb(bits, _DVX), table)
            known[b, at + VY] += noise.velocity * to_normal(absorb(bits, _DVY), table)
            c, s = _turn(bits, noise.direction, table)
            ux, uy = np.float64(states[b, at + UX]), np.float64(states[b, at + UY])
            known[b, at + UX], known[b, at + UY] = c * ux - s * uy, s * ux + c * uy


@kernel
def stay_on_target(states: Float, active: Bool, known: Float) -> None:
    """Keeps targets that are where their robot is, as of one that knows no evader, at it.

    They follow from the robot's measured position as from its true one, which they would tell.
    """
    for b in range(known.shape[0]):
        if not active[b]:
            continue
        for i in range(known.shape[1] // N_COLUMNS):
            at = N_COLUMNS * i
            if states[b, at + TX] == states[b, at + X] and states[b, at + TY] == states[b, at + Y]:
                known[b, at + TX], known[b, at + TY] = known[b, at + X], known[b, at + Y]


@kernel(inline="always")
def _displacement(
    dx: float, dy: float, bits: np.uint64, noise: Noise, by_range: bool, table: Double
) -> tuple[float, float]:
    """Returns a measured displacement, by components or by range and bearing."""
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
    states: Float,  # [E, S]
    known: Float,  # [E, 8 N] the robots' measurements of themselves
    b: int,  # the copy
    me: int,  # first column of the robot that measures
    at: int,  # first column of the measured object
    bits: np.uint64,  # of the draws for this object
    noise: Noise,  # standard deviations
    by_range: bool,  # whether its position is measured by range and bearing
    heading: tuple[float, float],  # cosine and sine of the error of the robot's heading that turns
    # what it sees
    table: Double,  # quantiles of the normal distribution
    measured: Float,  # [E, S] written
) -> None:
    """Writes the first six columns of a robot or body as robot `me` measures them."""
    hc, hs = heading
    dx = np.float64(states[b, at + X]) - np.float64(states[b, me + X])
    dy = np.float64(states[b, at + Y]) - np.float64(states[b, me + Y])
    dx, dy = _displacement(dx, dy, bits, noise, by_range, table)
    measured[b, at + X] = np.float64(known[b, me + X]) + (hc * dx - hs * dy)
    measured[b, at + Y] = np.float64(known[b, me + Y]) + (hs * dx + hc * dy)
    dvx = np.float64(states[b, at + VX]) - np.float64(states[b, me + VX])
    dvy = np.float64(states[b, at + VY]) - np.float64(states[b, me + VY])
    dvx += noise.velocity * to_normal(absorb(bits, _DVX), table)
    dvy += noise.velocity * to_normal(absorb(bits, _DVY), table)
    measured[b, at + VX] = np.float64(known[b, me + VX]) + (hc * dvx - hs * dvy)
    measured[b, at + VY] = np.float64(known[b, me + VY]) + (hs * dvx + hc * dvy)
    c, s = _turn(bits, noise.direction, table)
    ux = np.float64(states[b, at + UX]) * hc - np.float64(states[b, at + UY]) * hs
    uy = np.float64(states[b, at + UX]) * hs + np.float64(states[b, at + UY]) * hc
    measured[b, at + UX], measured[b, at + UY] = c * ux - s * uy, s * ux + c * uy


@kernel(inline="always")
def _see_obstacle(
    states: Float,
    layouts: Float,
    known: Float,
    b: int,
    me: int,
    m: int,
    bits: np.uint64,
    noise: Noise,
    heading: tuple[float, float],
    table: Double,
    measured: Float,
) -> None:
    """Writes row m of a layout as a robot measures it, measured [E, M, 8]; see `_see_body`."""
    hc, hs = heading
    dx = np.float64(layouts[b, m, 1]) - np.float64(states[b, me + X])
    dy = np.float64(layouts[b, m, 2]) - np.float64(states[b, me + Y])
    dx, dy = _displacement(dx, dy, bits, noise, False, table)
    c, s = _turn(bits, noise.direction, table)
    ux = np.float64(layouts[b, m, 3]) * hc - np.float64(layouts[b, m, 4]) * hs
    uy = np.float64(layouts[b, m, 3]) * hs + np.float64(layouts[b, m, 4]) * hc
    measured[b, m, 0] = layouts[b, m, 0]
    measured[b, m, 1] = np.float64(known[b, me + X]) + (hc * dx - hs * dy)
    measured[b, m, 2] = np.float64(known[b, me + Y]) + (hs * dx + hc * dy)
    measured[b, m, 3], measured[b, m, 4] = c * ux - s * uy, s * ux + c * uy
    for k in range(5, 8):
        measured[b, m, k] = layouts[b, m, k]


@kernel(inline="always")
def _miss(
    measured: Float,
    layouts: Float,
    b: int,
    i: int,
    n: int,
    first: int,
    chance: np.uint64,
    dropout: float,
) -> None:
    """Puts what robot i misses at NaN: other robots, and obstacles, numbered from `first` on."""
    for j in range(n):
        if j != i and to_uniform(absorb(chance, j)) < dropout:
            measured[b, N_COLUMNS * j + X], measured[b, N_COLUMNS * j + Y] = np.nan, np.nan
    for m in range(layouts.shape[1]):
        if to_uniform(absorb(chance, first + m)) < dropout:
            layouts[b, m, 1], layouts[b, m, 2] = np.nan, np.nan


@kernel
def _copy_state(state: Float, known: Float, me: int, measured: Float) -> None:
    """Writes a copy of a state in which the robot's own columns are what it knows of itself."""
    for c in range(state.shape[0]):
        measured[c] = state[c]
    for c in range(me, me + N_COLUMNS):
        measured[c] = known[c]


@kernel(error_model="numpy")
def look_around(
    states: Float,  # [E, S]
    layouts: Float,  # [E, M, 8]
    known: Float,  # [E, 8 N] the robots' measurements of themselves, from `localise`
    errors: Double,  # [E, N, 2] cosine and sine of the drift of their headings
    i: int,  # index of the robot that measures
    survey: Survey,  # how it measures
    seeds: Seeds,  # [E] of the episodes
    times: Int,  # [E] control steps since their reset
    active: Bool,  # [E] copies to write
    table: Double,  # quantiles of the normal distribution, from `random.normal_table`
    measured: Float,  # [E, S] states, written
    measured_layouts: Float,  # [E, M, 8] written
) -> None:
    """Writes the world as robot i of every active copy measures it.

    An object's measured position is the robot's own plus the measured displacement.
    """
    n, arms, me = survey.n_agents, survey.arms, N_COLUMNS * i
    first = n + arms.shape[0]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        noise = _noise_of(seeds[b], i, survey)
        measurement = _measurement(seeds[b], times[b], i)
        sight, heading = absorb(measurement, _OF_OBJECTS), (1.0, 0.0)
        if survey.in_body:
            heading = _turn(absorb(measurement, _OF_ITSELF), noise.direction, table)
        (hc, hs), c, s = heading, errors[b, i, 0], errors[b, i, 1]
        heading = (hc * c - hs * s, hs * c + hc * s)
        _copy_state(states[b], known[b], me, measured[b])
        for j in range(first):
            bits, is_robot = absorb(sight, j), j < n
            at = N_COLUMNS * j if is_robot else N_COLUMNS * n + N_BODY * (j - n)
            by_range = survey.by_range and is_robot
            if j != i:
                _see_body(states, known, b, me, at, bits, noise, by_range, heading, table, measured)
            if not is_robot:
                rate = noise.velocity / arms[j - n]
                measured[b, at + N_BODY - 1] += rate * to_normal(absorb(bits, _TURN_RATE), table)
        for m in range(layouts.shape[1]):
            bits = absorb(sight, first + m)
            out = measured_layouts
            _see_obstacle(states, layouts, known, b, me, m, bits, noise, heading, table, out)
        if survey.dropout > 0.0:
            chance = absorb(measurement, _OF_LOSSES)
            _miss(measured, measured_layouts, b, i, n, first, chance, survey.dropout)
