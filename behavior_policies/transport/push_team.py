"""How a team pushes: who goes to which place, who is in place, and how hard each one pushes.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import numpy as np

from swarmdata.behavior_policies.transport.payload_detour import crosses
from swarmdata.envs.transport.payload import Shape
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Int

DETOUR = 1.0
"""Metres that going around the payload counts for in the choice of who goes where."""

WORTH = 0.02
"""Square metres of shorter ways for which robots swap their places."""

ASIDE, AWAY = 0.06, 0.05
"""Metres along and off the face within which a robot is in place."""

LOST = 0.14
"""Metres from its place, along or off the face, beyond which a pushing robot has lost it."""

ARC_ASIDE = 0.3
"""Metres from its place at which a robot in contact with a circle pushes all the same."""

ENOUGH, TRUE = 1.05, 0.93
"""Times the friction that a push must have, and its least cosine with the way, to begin it."""

SPEED = 0.4
"""Speed (m/s) of the payload that the team tries to hold; it leaves robots room to catch up."""

RESPONSE = 0.5
"""Seconds in which an error of the payload's velocity is taken away."""

TURN_DAMPING = 5.0
"""Force against turning, N per (rad/s of turn rate times m of lever)."""


@kernel
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


@kernel
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


@kernel
def contact(
    robot: Double, inset: float, body: Double, shape: Shape, slot: Double
) -> tuple[float, float, float, float]:
    """Where a robot would push, seen from its place.

    At a box it pushes along the face's normal, wherever it stands; at a circle towards the centre.

    Args:
        robot: position first, [any].
        inset: how much smaller the robot's radius is than that of the places, m.
        body: columns `states.BODY`, [7].
        shape: of the payload.
        slot: its place, [4].

    Returns:
        Direction of its push, and how far its place is to the left and ahead of it, m.
    """
    dx, dy, nx, ny = slot[0] - robot[0], slot[1] - robot[1], slot[2], slot[3]
    ahead = dx * nx + dy * ny
    if shape[0] == CIRCLE:
        bx, by = body[0] - robot[0], body[1] - robot[1]
        d = max(np.sqrt(bx * bx + by * by), 1e-9)
        sx, sy = body[0] - slot[0], body[1] - slot[1]
        nx, ny = bx / d, by / d
        ahead = d - np.sqrt(sx * sx + sy * sy)
    return nx, ny, dy * nx - dx * ny, ahead + inset


@kernel
def stands(left: float, ahead: float, is_circle: bool, was_pushing: bool) -> bool:
    """Whether a robot is in place, by what `contact` returned."""
    aside = ARC_ASIDE if is_circle else (LOST if was_pushing else ASIDE)
    away = LOST if was_pushing else AWAY
    return abs(left) < aside and abs(ahead) < away


@kernel
def possible_way(way: tuple[float, float], pushes: Double) -> tuple[float, float]:
    """The direction nearest to the way in which such pushes can move the payload.

    Args:
        way: unit vector.
        pushes: positions and directions, [K, 4].

    Returns:
        A unit vector, or (0, 0) where none of the pushes is along the way.
    """
    wx, wy = 0.0, 0.0
    for k in range(pushes.shape[0]):
        nx, ny = pushes[k, 2], pushes[k, 3]
        ahead = max(way[0] * nx + way[1] * ny, 0.0) / _share(pushes, k)
        wx, wy = wx + ahead * nx, wy + ahead * ny
    length = np.sqrt(wx * wx + wy * wy)
    if length < 1e-9:
        return 0.0, 0.0
    return wx / length, wy / length


@kernel
def _share(pushes: Double, k: int) -> float:
    """How many robots share the work of push k: parallel ones count fully."""
    share = 0.0
    for j in range(pushes.shape[0]):
        along = max(pushes[j, 2] * pushes[k, 2] + pushes[j, 3] * pushes[k, 3], 0.0)
        share += along * along
    return share


@kernel
def _share_force(
    body: Double, wanted: tuple[float, float], pushes: Double, most: float, out: Double
) -> tuple[float, float, float]:
    """Shares a force among pushes, weakened in its direction until no robot exceeds `most`, N.

    Returns:
        The force and the torque that come of it, N and N m.
    """
    peak = most
    for k in range(pushes.shape[0]):
        along = wanted[0] * pushes[k, 2] + wanted[1] * pushes[k, 3]
        out[k] = max(along, 0.0) / _share(pushes, k)
        peak = max(peak, out[k])
    x, y, torque = 0.0, 0.0, 0.0
    for k in range(pushes.shape[0]):
        out[k] *= most / peak
        fx, fy = out[k] * pushes[k, 2], out[k] * pushes[k, 3]
        x, y = x + fx, y + fy
        torque += (pushes[k, 0] - body[0]) * fy - (pushes[k, 1] - body[1]) * fx
    return x, y, torque


@kernel
def push_forces(
    body: Double, way: tuple[float, float], pushes: Double, payload: Double, out: Double
) -> bool:
    """Writes the force (N) of each push that moves the payload along its way.

    The team's force overcomes friction and corrects the velocity; it is shared among the robots
    of a face, and more goes to the side that lags.

    Args:
        body: columns `states.BODY`, [7].
        way: unit vector, from `possible_way`.
        pushes: positions and directions, [K, 4].
        payload: its mass with the robots', kg; friction, N; most force of a robot, N; most torque
            that friction holds, N m; [4].
        out: written, not negative, [K].

    Returns:
        Whether these pushes start it on its way, near enough and without turning it.
    """
    mass, friction, most = payload[0] / RESPONSE, payload[1], payload[2]
    fx = friction * way[0] + mass * (SPEED * way[0] - body[2])
    fy = friction * way[1] + mass * (SPEED * way[1] - body[3])
    start = friction + mass * SPEED
    x, y, torque = _share_force(body, (start * way[0], start * way[1]), pushes, most, out)
    ahead, total = x * way[0] + y * way[1], np.sqrt(x * x + y * y)
    _share_force(body, (fx, fy), pushes, most, out)
    for k in range(pushes.shape[0]):
        lever = (pushes[k, 0] - body[0]) * pushes[k, 3] - (pushes[k, 1] - body[1]) * pushes[k, 2]
        out[k] = min(max(out[k] - TURN_DAMPING * body[6] * lever, 0.0), most)
    return ahead > ENOUGH * friction and ahead > TRUE * total and abs(torque) < payload[3]
