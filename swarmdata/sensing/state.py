"""The `state` model: low-dimensional features in the world's frame, for robots that localise.

Arithmetic as in `geometry`.
"""

import math

import numpy as np
from numba import njit

from swarmdata.features import Feature, numbered, vector
from swarmdata.geometry import bounding_radius, nearest
from swarmdata.senses import StateModel
from swarmdata.sensing.scene import Scene
from swarmdata.states import N_COLUMNS, TX, TY, UX, VX, VY, X, Y
from swarmdata.types import Bool, Double, Float

_TO_TARGET = "target minus own position"
_TARGET_DIRECTION = "unit vector to the target, shrinking within 0.3 m of it"
_NEAR = "direction to the nearest surface point times closeness: 0 at the range, 1 in contact"

OWN = (
    Feature("own.x", "position", "x", "own position"),
    Feature("own.y", "position", "y", "own position"),
    Feature("own.vx", "velocity", "x", "own velocity"),
    Feature("own.vy", "velocity", "y", "own velocity"),
    Feature("own.goal_dx", "position", "x", _TO_TARGET),
    Feature("own.goal_dy", "position", "y", _TO_TARGET),
    Feature("own.goal_ux", "direction", "x", _TARGET_DIRECTION),
    Feature("own.goal_uy", "direction", "y", _TARGET_DIRECTION),
)

HEADING = vector("own.heading", "direction", "own heading")
"""Follows `OWN` in teams with a unicycle."""

NEIGHBOR = (
    Feature("dx", "position", "x", "position relative to the own"),
    Feature("dy", "position", "y", "position relative to the own"),
    Feature("dvx", "velocity", "x", "velocity relative to the own"),
    Feature("dvy", "velocity", "y", "velocity relative to the own"),
    *vector("near", "direction", "direction to it times closeness: 0 at the range, 1 in contact"),
    Feature("mask", "flag", meaning="1 if the slot holds a robot; nearest first"),
)

OBSTACLE = (
    *vector("near", "direction", _NEAR),
    Feature("dx", "position", "x", "center relative to the own position"),
    Feature("dy", "position", "y", "center relative to the own position"),
    *vector("axis", "position", "local x axis times the bounding radius"),
    Feature("kind", "flag", meaning="shape: 0 circle, 1/3 box, 2/3 corner, 1 pocket"),
    Feature("mask", "flag", meaning="1 if the slot holds an obstacle; nearest first"),
)

GOAL_NEAR = 0.3
"""Distance (m) below which the goal direction shrinks linearly to zero."""

_SLACK = 1.0 + 1e-12
"""So that rounding in a first, cheap test never excludes what the exact one would keep."""

_OWN, _NEIGHBOR, _OBSTACLE = len(OWN), len(NEIGHBOR), len(OBSTACLE)


class State:
    """Self, nearest robots and nearest obstacles, in the world's frame.

    Features: `OWN`, `HEADING` in teams with a unicycle, then the slots of `NEIGHBOR` and of
    `OBSTACLE`, nearest surface first. A slot without a return is zero.

    Args:
        model: how many slots, and how far robots see.
        scene: what there is to see.
    """

    def __init__(self, model: StateModel, scene: Scene) -> None:
        own = OWN + (HEADING if scene.has_headings else ())
        near = numbered("neighbor", model.n_neighbors, NEIGHBOR)
        around = numbered("obstacle", model.n_obstacles, OBSTACLE)
        self.features = own + near + around
        self.metres = np.ones(len(self.features))
        limit = np.inf if model.limit is None else model.limit
        self._radii, self._limits = scene.radii, np.minimum(scene.ranges, limit)
        self._slots, self._reach = (len(own), model.n_neighbors, model.n_obstacles), model.range

    def sense(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        """Writes `features` of every robot of the active copies, [E, N, F]."""
        observe_states(
            states, layouts, self._radii, self._limits, self._slots, self._reach, active, out
        )


@njit(nogil=True, cache=True, inline="always")
def _insert(found: Double, k: int, gap: float, index: int, vx: float, vy: float) -> None:
    """Keeps the k smallest gaps in order, as rows (gap, index, vx, vy); ties keep the first."""
    if k == 0 or gap >= found[k - 1, 0]:
        return
    slot = k - 1
    while slot > 0 and found[slot - 1, 0] > gap:
        for c in range(4):
            found[slot, c] = found[slot - 1, c]
        slot -= 1
    found[slot, 0] = gap
    found[slot, 1] = index
    found[slot, 2] = vx
    found[slot, 3] = vy


@njit(nogil=True, cache=True, inline="always")
def _forget(found: Double, k: int) -> None:
    for slot in range(k):
        found[slot, 0] = np.inf
        found[slot, 1] = -1.0


@njit(nogil=True, cache=True, inline="always")
def _closeness(gap: float, reach: float) -> float:
    """1 at contact, falling linearly to 0 at a gap of `reach`."""
    return min(max(1.0 - gap / reach, 0.0), 1.0)


@njit(nogil=True, cache=True)
def _own(out: Float, state: Float, at: int) -> None:
    """Fills `OWN`, and `HEADING` if there is room, of the robot whose state begins at `at`."""
    gx = float(state[at + TX]) - float(state[at + X])
    gy = float(state[at + TY]) - float(state[at + Y])
    scale = 1.0 / max(math.sqrt(gx * gx + gy * gy), GOAL_NEAR)
    for c in range(4):
        out[c] = state[at + c]
    out[4] = gx
    out[5] = gy
    out[6] = gx * scale
    out[7] = gy * scale
    for c in range(out.shape[0] - _OWN):
        out[_OWN + c] = state[at + UX + c]


@njit(nogil=True, cache=True)
def _neighbors(
    out: Float,
    state: Float,
    i: int,
    radii: Double,
    k: int,
    reach: float,
    limit: float,
    found: Double,
) -> None:
    """Fills the neighbour slots of robot i, nearest first."""
    _forget(found, k)
    at = N_COLUMNS * i
    px, py = float(state[at + X]), float(state[at + Y])
    for j in range(radii.shape[0] if k > 0 else 0):
        dx = float(state[N_COLUMNS * j + X]) - px
        dy = float(state[N_COLUMNS * j + Y]) - py
        square, bound = dx * dx + dy * dy, found[k - 1, 0] + radii[i] + radii[j]
        if j != i and (bound < 0.0 or square < bound * bound * _SLACK):
            gap = math.sqrt(square) - radii[i] - radii[j]
            if gap <= limit:
                _insert(found, k, gap, j, dx, dy)
    for slot in range(k):
        o = out[_NEIGHBOR * slot : _NEIGHBOR * slot + _NEIGHBOR]
        gap, dx, dy = found[slot, 0], found[slot, 2], found[slot, 3]
        j = int(found[slot, 1])
        if j < 0:
            o[:] = 0.0
            continue
        close = _closeness(gap, reach) / max(math.sqrt(dx * dx + dy * dy), 1e-9)
        o[0] = dx
        o[1] = dy
        o[2] = float(state[N_COLUMNS * j + VX]) - float(state[at + VX])
        o[3] = float(state[N_COLUMNS * j + VY]) - float(state[at + VY])
        o[4] = dx * close
        o[5] = dy * close
        o[6] = 1.0


@njit(nogil=True, cache=True)
def _obstacles(
    out: Float,
    px: float,
    py: float,
    layout: Float,
    sizes: Double,
    radius: float,
    k: int,
    reach: float,
    limit: float,
    found: Double,
) -> None:
    """Fills the obstacle slots of a robot at (px, py), nearest surface first."""
    _forget(found, k)
    for m in range(layout.shape[0] if k > 0 else 0):
        dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
        bound = found[k - 1, 0] + radius + sizes[m]
        if bound > 0.0 and dx * dx + dy * dy < bound * bound:
            distance, vx, vy = nearest(px, py, layout[m])
            if distance - radius <= limit:
                _insert(found, k, distance - radius, m, vx, vy)
    for slot in range(k):
        o = out[_OBSTACLE * slot : _OBSTACLE * slot + _OBSTACLE]
        gap, vx, vy = found[slot, 0], found[slot, 2], found[slot, 3]
        m = int(found[slot, 1])
        if m < 0:
            o[:] = 0.0
            continue
        close = _closeness(gap, reach) / max(gap + radius, 1e-9)
        o[0] = vx * close
        o[1] = vy * close
        o[2] = float(layout[m, 1]) - px
        o[3] = float(layout[m, 2]) - py
        o[4] = float(layout[m, 3]) * sizes[m]
        o[5] = float(layout[m, 4]) * sizes[m]
        o[6] = float(layout[m, 0]) / 3.0
        o[7] = 1.0


@njit(nogil=True, cache=True)
def observe_states(
    states: Float,
    layouts: Float,
    radii: Double,
    limits: Double,
    slots: tuple[int, int, int],
    reach: float,
    active: Bool,
    observations: Float,
) -> None:
    """Writes the `state` observation of every robot in every active copy.

    Args:
        states: [E, S].
        layouts: obstacles, [E, M, 8].
        radii: robot radii, m, [N].
        limits: gaps beyond which each robot sees nothing, m, [N].
        slots: length of the own block, number of neighbour and of obstacle slots.
        reach: gap (m) at which closeness features reach 0.
        active: copies to observe, [E]; rows of the others are not written.
        observations: written, [E, N, O].
    """
    n_own, n_neighbors, n_obstacles = slots
    found = np.empty((max(n_neighbors, n_obstacles), 4))
    sizes = np.empty(layouts.shape[1])
    first = n_own + _NEIGHBOR * n_neighbors
    last = first + _OBSTACLE * n_obstacles
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        layout, state = layouts[b], states[b]
        for m in range(layout.shape[0]):
            sizes[m] = bounding_radius(layout[m])
        for i in range(radii.shape[0]):
            out, at = observations[b, i], N_COLUMNS * i
            px, py = float(state[at + X]), float(state[at + Y])
            _own(out[:n_own], state, at)
            near = out[n_own:first]
            _neighbors(near, state, i, radii, n_neighbors, reach, limits[i], found)
            around = out[first:last]
            _obstacles(
                around, px, py, layout, sizes, radii[i], n_obstacles, reach, limits[i], found
            )
