"""How a team pushes: who goes to which place, who is in place, and how hard each one pushes.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import numpy as np
from numba import njit

from swarmdata.behavior_policies.way_around import crosses
from swarmdata.envs.payload import Shape
from swarmdata.types import Double, Int

DETOUR = 1.0
"""Metres that going around the payload counts for in the choice of who goes where."""

WORTH = 0.02
"""Square metres of shorter ways for which robots swap their places."""

ASIDE, AWAY = 0.06, 0.05
"""Metres along and off the face within which a robot is in place."""

LOST = 0.14
"""Metres from its place, along or off the face, beyond which a pushing robot has lost it."""

SPEED = 0.4
"""Speed (m/s) of the payload that the team tries to hold; it leaves robots room to catch up."""

RESPONSE = 0.5
"""Seconds in which an error of the payload's velocity is taken away."""

TURN_DAMPING = 5.0
"""Force against turning, N per (rad/s of turn rate times m of lever)."""


@njit(nogil=True, cache=True)
def assign_slots(
    robots: Double, body: Double, shape: Shape, slots: Double, margin: float, out: Int
) -> None:
    """Writes the place of each robot, or -1; starts from those in `out` if all places are taken.

    Ways count by their squares: two robots go a little rather than one past the other.

    Args:
        robots: positions first, [N, any].
        body: columns `states.BODY`, [7].
        shape: of the payload.
        slots: from `push_slots.choose_slots`, [K, 4], K at most N.
        margin: by which a straight way must miss the payload, m.
        out: read and written, [N].
    """
    n, k = robots.shape[0], slots.shape[0]
    costs = np.empty((n, k))
    for i in range(n):
        for s in range(k):
            x, y = slots[s, 0] - 0.03 * slots[s, 2], slots[s, 1] - 0.03 * slots[s, 3]
            dx, dy = x - robots[i, 0], y - robots[i, 1]
            way = np.sqrt(dx * dx + dy * dy)
            if crosses(body, shape, (robots[i, 0], robots[i, 1]), (x, y), margin):
                way += DETOUR
            costs[i, s] = way * way
    if (out >= 0).sum() != k or out.max() >= k:
        out[:] = -1
        for s in range(k):
            best, robot = np.inf, 0
            for i in range(n):
                if out[i] < 0 and costs[i, s] < best:
                    best, robot = costs[i, s], i
            out[robot] = s
    _swap(costs, out)


@njit(nogil=True, cache=True)
def _swap(costs: Double, out: Int) -> None:
    """Swaps the places of two robots as long as that shortens their ways together."""
    n, again = costs.shape[0], True
    while again:
        again = False
        for i in range(n):
            for j in range(n):
                if out[i] < 0:
                    continue
                now, new = costs[i, out[i]], costs[j, out[i]]
                if out[j] >= 0:
                    now, new = now + costs[j, out[j]], new + costs[i, out[j]]
                if new < now - WORTH:
                    out[i], out[j] = out[j], out[i]
                    again = True


@njit(nogil=True, cache=True)
def place_errors(robot: Double, slot: Double, inset: float) -> tuple[float, float]:
    """How far a robot is from its place: along the face, and off it (m).

    Args:
        robot: position first, [any].
        slot: one place, [4].
        inset: how much smaller the robot's radius is than that of the places, m.
    """
    dx, dy = slot[0] - robot[0], slot[1] - robot[1]
    nx, ny = slot[2], slot[3]
    return dy * nx - dx * ny, dx * nx + dy * ny + inset


@njit(nogil=True, cache=True)
def keeps_pushing(
    robots: Double, places: Int, slots: Double, insets: Double, is_pushing: bool
) -> bool:
    """Whether the team pushes: it starts when all are in place, and stops when one is lost.

    Args:
        robots: positions first, [N, any].
        places: of the robots, or -1, [N].
        slots: [K, 4].
        insets: see `place_errors`, [N].
        is_pushing: whether it did so before.
    """
    aside, away = (LOST, LOST) if is_pushing else (ASIDE, AWAY)
    for i in range(robots.shape[0]):
        if places[i] >= 0:
            along, off = place_errors(robots[i], slots[places[i]], insets[i])
            if abs(along) > aside or abs(off) > away:
                return False
    return slots.shape[0] > 0


@njit(nogil=True, cache=True)
def push_forces(
    body: Double, way: tuple[float, float], slots: Double, payload: Double, out: Double
) -> None:
    """Writes the force (N) at each place that moves the payload along its way.

    The team's force overcomes friction and corrects the velocity; it is shared among the robots
    of a face, and more goes to the side that lags. Where the places allow no push along the way,
    it is along the nearest direction that they allow.

    Args:
        body: columns `states.BODY`, [7].
        way: unit vector.
        slots: [K, 4].
        payload: its mass with the robots', kg; friction, N; [2].
        out: written, not negative, [K].
    """
    mass, friction, n = payload[0] / RESPONSE, payload[1], slots.shape[0]
    shares, wx, wy = np.zeros(n), 0.0, 0.0
    for k in range(n):
        nx, ny = slots[k, 2], slots[k, 3]
        for j in range(n):
            along = max(slots[j, 2] * nx + slots[j, 3] * ny, 0.0)
            shares[k] += along * along
        ahead = max(way[0] * nx + way[1] * ny, 0.0) / shares[k]
        wx, wy = wx + ahead * nx, wy + ahead * ny
    length = max(np.sqrt(wx * wx + wy * wy), 1e-9)
    wx, wy = wx / length, wy / length
    fx = friction * wx + mass * (SPEED * wx - body[2])
    fy = friction * wy + mass * (SPEED * wy - body[3])
    for k in range(n):
        x, y, nx, ny = slots[k]
        lever = (x - body[0]) * ny - (y - body[1]) * nx
        out[k] = max((fx * nx + fy * ny) / shares[k] - TURN_DAMPING * body[6] * lever, 0.0)
