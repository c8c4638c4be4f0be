"""Odometry: the pose that a robot believes in, from how it has driven and turned.

A robot knows its pose when an episode begins. From then on it adds up its displacements and turns
in each control step, in its own frame, both measured with errors (`sensing_models.Drift`).
With rates p, h and t of position, heading and turning, a step of d metres and a turn of a radians,

    measured displacement = (1 + p B0) true one + p sqrt(d) (W0, W1)
    measured turn         = a + h B1 d + t B2 a + sqrt(h^2 d + t^2 |a|) W2

B are normal draws of the episode and the robot, W of the step. The heading of a holonomic robot
does not drift, and no pose is wrong where a landmark is in range: the corners and the middle of the
arena. Turns are taken as their sines, and a heading is turned by 2 atan(a / 2), for the bits.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.numerics.random import STREAMS, normal_table
from swarmdata.numerics.random_kernels import absorb, to_normal
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.sensing_models import Drift
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, UY, VX, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

_STREAM = STREAMS["odometry"]

_POSE = 4  # columns of a pose: x, y, and a direction


class Rates(NamedTuple):
    """Constants of a spec; see `sensing_models.Drift`."""

    position: float  # m per m
    heading: float  # rad per m
    turning: float  # rad per rad
    turns: Bool  # [N] whether a robot's heading can drift
    landmarks: Double  # [L, 2] m
    reach: float  # m, within which a landmark tells a robot's pose


class Odometry:
    """Adds up the displacements and turns of the robots of E copies."""

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        drift, n = spec.observation.drift, spec.n_agents
        width, height = spec.half_size
        corners = [(x, y) for x in (-width, width) for y in (-height, height)]
        reach = spec.observation.landmarks
        places = [] if reach is None else [(0.0, 0.0), *corners]
        self._rates = Rates(
            **drift.model_dump(),
            turns=np.array([robot.dynamics == "unicycle" for robot in spec.robots]),
            landmarks=np.array(places, dtype=np.float64).reshape(-1, 2),
            reach=reach or 0.0,
        )
        self.is_exact = drift == Drift()
        self._begun: Bool = np.zeros(n_copies, dtype=np.bool_)
        self._last: Double = np.zeros((n_copies, n, _POSE))
        self._believed: Double = np.zeros((n_copies, n, 2))
        # direction (cosine and sine) of each believed heading from the true one, [E, N, 2]
        self.errors: Double = np.zeros((n_copies, n, 2))
        self.errors[..., 0] = 1.0

    def forget(self, copies: Int) -> None:
        """Makes the next step of each of these copies the first of an episode."""
        self._begun[copies] = False

    def advance(self, step: Step, active: Bool, known: Float) -> None:
        """Takes a step of the active copies, [E], and adds its errors to `known`, [E, 8 N].

        These are measurements of themselves, without drift before. Call it once for every step
        of an episode.
        """
        reckon(
            step.states, step.seeds, step.times, active, self._rates, normal_table(), self._begun,
            self._last, self._believed, self.errors,
        )  # fmt: skip
        add_errors(step.states, active, self._believed, self.errors, known)


@kernel(inline="always")
def _sees_landmark(x: float, y: float, rates: Rates) -> bool:
    for m in range(rates.landmarks.shape[0]):
        dx, dy = rates.landmarks[m, 0] - x, rates.landmarks[m, 1] - y
        if dx * dx + dy * dy <= rates.reach * rates.reach:
            return True
    return False


@kernel(inline="always")
def _draws(bits: np.uint64, table: Double) -> tuple[float, float, float]:
    """Three normal draws."""
    return (
        to_normal(absorb(bits, 0), table),
        to_normal(absorb(bits, 1), table),
        to_normal(absorb(bits, 2), table),
    )


@kernel(error_model="numpy")
def reckon(
    states: Float,  # [E, S]
    seeds: Seeds,  # [E] of the episodes
    times: Int,  # [E] control steps since their reset
    active: Bool,  # [E] copies to change
    rates: Rates,  # of the drift
    table: Double,  # quantiles of the normal distribution, from `random.normal_table`
    begun: Bool,  # [E] whether there was a step before, changed
    last: Double,  # [E, N, 4] true x, y, ux, uy after the step before, changed
    believed: Double,  # [E, N, 2] positions, m, changed
    errors: Double,  # [E, N, 2] of headings, changed
) -> None:
    """Adds a step of every robot of the active copies to where it believes to be."""
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        for i in range(last.shape[1]):
            at, own = N_COLUMNS * i, last[b, i]
            x, y = float(states[b, at + X]), float(states[b, at + Y])
            ux, uy = float(states[b, at + UX]), float(states[b, at + UY])
            if begun[b] and not _sees_landmark(x, y, rates):
                bits = absorb(absorb(seeds[b], _STREAM), i)
                bias = _draws(absorb(bits, 0), table)
                walk = _draws(absorb(bits, times[b] + 1), table)
                dx, dy = x - own[0], y - own[1]
                distance = math.sqrt(dx * dx + dy * dy)
                turn = own[2] * uy - own[3] * ux
                c, s = errors[b, i, 0], errors[b, i, 1]
                scale, wide = 1.0 + rates.position * bias[0], rates.position * math.sqrt(distance)
                believed[b, i, 0] += scale * (c * dx - s * dy) + wide * walk[0]
                believed[b, i, 1] += scale * (s * dx + c * dy) + wide * walk[1]
                if rates.turns[i]:
                    angle = rates.heading * bias[1] * distance + rates.turning * bias[2] * turn
                    variance = rates.heading * rates.heading * distance
                    variance += rates.turning * rates.turning * abs(turn)
                    half = 0.5 * (angle + math.sqrt(variance) * walk[2])
                    share = 1.0 / (1.0 + half * half)
                    tc, ts = (1.0 - half * half) * share, 2.0 * half * share
                    ec, es = c * tc - s * ts, s * tc + c * ts
                    norm = math.sqrt(ec * ec + es * es)
                    errors[b, i, 0], errors[b, i, 1] = ec / norm, es / norm
            else:
                believed[b, i, 0], believed[b, i, 1] = x, y
                errors[b, i, 0], errors[b, i, 1] = 1.0, 0.0
            own[0], own[1], own[2], own[3] = x, y, ux, uy
        begun[b] = True


@kernel
def add_errors(states: Float, active: Bool, believed: Double, errors: Double, known: Float) -> None:
    """Moves and turns what the robots of the active copies know of themselves, [E, 8 N].

    A target where a robot is that has it too, as the evader of `tag`, is known from seeing that
    robot, and drifts along: a place without errors, beside one that is seen, tells the true pose.
    """
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        for i in range(believed.shape[1]):
            at, c, s = N_COLUMNS * i, errors[b, i, 0], errors[b, i, 1]
            tx, ty = states[b, at + TX], states[b, at + TY]
            for other in range(0, N_COLUMNS * believed.shape[1], N_COLUMNS):
                is_there = states[b, other + X] == tx and states[b, other + Y] == ty
                if is_there and states[b, other + TX] == tx and states[b, other + TY] == ty:
                    dx, dy = float(tx) - states[b, at + X], float(ty) - states[b, at + Y]
                    known[b, at + TX] = believed[b, i, 0] + (c * dx - s * dy)
                    known[b, at + TY] = believed[b, i, 1] + (s * dx + c * dy)
            known[b, at + X] += believed[b, i, 0] - float(states[b, at + X])
            known[b, at + Y] += believed[b, i, 1] - float(states[b, at + Y])
            for column in (VX, UX):
                x, y = float(known[b, at + column]), float(known[b, at + column + 1])
                known[b, at + column] = c * x - s * y
                known[b, at + column + 1] = s * x + c * y
