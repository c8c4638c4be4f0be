"""Observation models: pure functions of float32 states and layouts, one numba kernel per model.

The live environment and the re-observation of recorded data call the same functions. Arithmetic as
in `geometry`: float64, correctly rounded operations only, then one rounding to float32.
"""

import math

import numpy as np
from numba import njit

from swarmdata.geometry import bounding_radius, nearest, wall_gap
from swarmdata.types import Bool, Double, Float

OWN = ("x", "y", "vx", "vy", "goal_dx", "goal_dy", "goal_ux", "goal_uy")
NEIGHBOR = ("dx", "dy", "dvx", "dvy", "near_x", "near_y", "mask")
OBSTACLE = ("near_x", "near_y", "dx", "dy", "axis_x", "axis_y", "kind", "mask")

GOAL_NEAR = 0.3
"""Distance (m) below which the goal direction shrinks linearly to zero."""


def state_observation_size(n_neighbors: int, n_obstacles: int) -> int:
    """Length O of one robot's `state` observation."""
    return len(OWN) + len(NEIGHBOR) * n_neighbors + len(OBSTACLE) * n_obstacles


def state_observation_fields(n_neighbors: int, n_obstacles: int) -> tuple[str, ...]:
    """Names of the O features of one robot's `state` observation, in order."""
    near = [f"neighbor_{k}.{name}" for k in range(n_neighbors) for name in NEIGHBOR]
    around = [f"obstacle_{k}.{name}" for k in range(n_obstacles) for name in OBSTACLE]
    return (*(f"own.{name}" for name in OWN), *near, *around)


@njit(nogil=True, cache=True, inline="always")
def _insert(found: Double, k: int, gap: float, index: int, vx: float, vy: float) -> None:
    """Keeps the k smallest gaps in order, as rows (gap, index, vx, vy); ties keep the first."""
    if k == 0 or gap >= found[k - 1, 0]:
        return
    slot = k - 1
    while slot > 0 and found[slot - 1, 0] > gap:
        found[slot] = found[slot - 1]
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
def _own(out: Float, state: Float, i: int) -> None:
    """Own position, velocity, goal displacement and goal direction of robot i."""
    gx = float(state[8 * i + 6]) - float(state[8 * i])
    gy = float(state[8 * i + 7]) - float(state[8 * i + 1])
    scale = 1.0 / max(math.sqrt(gx * gx + gy * gy), GOAL_NEAR)
    for c in range(4):
        out[c] = state[8 * i + c]
    out[4] = gx
    out[5] = gy
    out[6] = gx * scale
    out[7] = gy * scale


@njit(nogil=True, cache=True)
def _neighbors(
    out: Float, state: Float, i: int, radii: Double, k: int, reach: float, found: Double
) -> float:
    """Fills the neighbour slots of robot i, nearest first; returns the smallest gap to a robot."""
    _forget(found, k)
    smallest = np.inf
    for j in range(radii.shape[0]):
        if j != i:
            dx = float(state[8 * j]) - float(state[8 * i])
            dy = float(state[8 * j + 1]) - float(state[8 * i + 1])
            gap = math.sqrt(dx * dx + dy * dy) - radii[i] - radii[j]
            smallest = min(smallest, gap)
            _insert(found, k, gap, j, dx, dy)
    for slot in range(k):
        o = out[7 * slot : 7 * slot + 7]
        gap, dx, dy = found[slot, 0], found[slot, 2], found[slot, 3]
        j = int(found[slot, 1])
        if j < 0:
            o[:] = 0.0
            continue
        close = _closeness(gap, reach) / max(math.sqrt(dx * dx + dy * dy), 1e-9)
        o[0] = dx
        o[1] = dy
        o[2] = float(state[8 * j + 2]) - float(state[8 * i + 2])
        o[3] = float(state[8 * j + 3]) - float(state[8 * i + 3])
        o[4] = dx * close
        o[5] = dy * close
        o[6] = 1.0
    return smallest


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
    found: Double,
) -> float:
    """Fills the obstacle slots of a robot, nearest surface first; returns the smallest gap."""
    _forget(found, k)
    smallest = np.inf
    for m in range(layout.shape[0]):
        dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
        bound = max(smallest, found[k - 1, 0] if k > 0 else -np.inf) + radius + sizes[m]
        if bound > 0.0 and dx * dx + dy * dy < bound * bound:
            distance, vx, vy = nearest(px, py, layout[m])
            smallest = min(smallest, distance - radius)
            _insert(found, k, distance - radius, m, vx, vy)
    for slot in range(k):
        o = out[8 * slot : 8 * slot + 8]
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
    return smallest


@njit(nogil=True, cache=True)
def observe_states(
    states: Float,
    layouts: Float,
    radii: Double,
    half: Double,
    slots: tuple[int, int],
    reach: float,
    active: Bool,
    observations: Float,
    gaps: Double,
) -> None:
    """Writes the `state` observation of every robot in every active copy.

    Args:
        states: [E, S], per robot (x, y, vx, vy, goal_x, goal_y).
        layouts: obstacles, [E, M, 8].
        radii: robot radii, m, [N].
        half: half width and half height of the arena, m, [2].
        slots: number of neighbour and of obstacle slots.
        reach: gap (m) at which closeness features reach 0.
        active: copies to observe, [E]; rows of the others are not written.
        observations: written, [E, N, O].
        gaps: written, smallest gap of each robot to a robot, obstacle or wall, m, [E, N].
    """
    found = np.empty((max(slots[0], slots[1]), 4))
    sizes = np.empty(layouts.shape[1])
    first = 8 + 7 * slots[0]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        layout = layouts[b]
        for m in range(layout.shape[0]):
            sizes[m] = bounding_radius(layout[m])
        for i in range(radii.shape[0]):
            out = observations[b, i]
            px, py = float(states[b, 8 * i]), float(states[b, 8 * i + 1])
            _own(out, states[b], i)
            gap = _neighbors(out[8:first], states[b], i, radii, slots[0], reach, found)
            around = _obstacles(
                out[first:], px, py, layout, sizes, radii[i], slots[1], reach, found
            )
            gap = min(gap, around)
            for wall in range(4):
                gap = min(gap, wall_gap(px, py, half, wall) - radii[i])
            gaps[b, i] = gap
