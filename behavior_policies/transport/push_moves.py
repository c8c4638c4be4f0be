"""How a robot of a pushing team moves: in its place, on its way there, and out of the way.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

from swarmdata.behavior_policies.navigation.avoidance import BRAKE, SURFACE_MARGIN
from swarmdata.behavior_policies.navigation.distance_field import MARGIN, Int32
from swarmdata.behavior_policies.navigation.orca import damper_half_plane
from swarmdata.behavior_policies.navigation.planner import free_distance, waypoint
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.behavior_policies.transport.payload_detour import way_around
from swarmdata.behavior_policies.transport.push_team import ASIDE, AWAY
from swarmdata.envs.transport.payload import Shape
from swarmdata.numerics.geometry import nearest
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double, Float

STANDOFF = 0.03
"""Gap (m) to the payload at which a robot waits until it is beside its place."""

FUNNEL = 0.25
"""Most metres by which a robot stays farther off while it is not beside its place."""

SHY, SHYNESS = 0.15, 0.2
"""Metres of free gap below which the payload's way turns from a surface, and how far at contact."""

KEEP = 0.35
"""Metres that robots without a place keep from the payload and its way."""

AHEAD = 1.5
"""Metres of the payload's way that they keep clear."""


@kernel
def follow_place(
    robot: Double,
    body: Double,
    push: tuple[float, float, float, float],
    force: float,
    dt: float,
    out: Double,
) -> None:
    """Writes the velocity of a robot in its place: with the payload, and pushing by `force` N.

    A robot of mass 1 kg that commands a velocity `force * dt` above its own accelerates by `force`.

    Args:
        robot: x, y, vx, vy, [any].
        body: columns `states.BODY`, [7].
        push: from `pushing.contact`.
        force: N.
        dt: control step, s.
        out: written: velocity, m/s, and distance to go, for the right of way, m, [any].
    """
    nx, ny, left, off = push
    ahead = body[2] * nx + body[3] * ny + APPROACH_RATE * off
    if force > 0.0:
        ahead = max(ahead, robot[2] * nx + robot[3] * ny + force * dt)
    side = body[3] * nx - body[2] * ny + APPROACH_RATE * left
    out[0], out[1], out[2] = ahead * nx - side * ny, ahead * ny + side * nx, 1.0


@kernel
def go_to_place(
    i: int,
    limits: Double,
    body: Double,
    shape: Shape,
    slot: Double,
    team: tuple[Double, Bool],
    rings: tuple[Double, Bool],
    ground: tuple[Float, Double],
    ways: tuple[Int32, Int32],
    out: Double,
) -> None:
    """Writes the velocity of a robot on its way to its place.

    Args:
        i: which robot.
        limits: radius, m, and maximum speed, m/s, first, [N, any].
        body: columns `states.BODY`, [7].
        shape: of the payload.
        slot: its place, [4].
        team: robots, positions first, [N, any], and which of them stand at the payload, [N].
        rings: from `way_around.fill_rings`.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        ways: costs and next nodes of the robots' way to the payload, for the time that they do not
            see it.
        out: written, see `follow_place`.
    """
    robot, radius = team[0][i], limits[i, 0]
    x, y, nx, ny = robot[0], robot[1], slot[2], slot[3]
    dx, dy = slot[0] - x, slot[1] - y
    along, off = dy * nx - dx * ny, dx * nx + dy * ny
    to_x, to_y = slot[0], slot[1]
    if abs(along) >= ASIDE or not -AWAY < off < 0.3:
        back = STANDOFF + min(abs(along), FUNNEL)  # straight in, between others
        to_x, to_y = slot[0] - back * nx, slot[1] - back * ny
        if free_distance(to_x, to_y, ground[0], ground[1]) < radius + MARGIN:
            to_x, to_y = slot[0] - STANDOFF * nx, slot[1] - STANDOFF * ny
        end = (to_x, to_y)
        found, to_x, to_y = way_around(body, shape, i, end, radius, ground, rings, team)
        if not found:
            to_x, to_y = waypoint((x, y), body[:2], radius, ground[0], ways, ground[1])
    dx, dy = to_x - x, to_y - y
    d = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    sx, sy = slot[0] - x, slot[1] - y
    left = math.sqrt(sx * sx + sy * sy)
    speed = min(limits[i, 1], APPROACH_RATE * left)
    out[0], out[1], out[2] = dx / d * speed, dy / d * speed, 1.0


@kernel
def keep_clear(
    robot: Double, limits: Double, body: Double, way: tuple[float, float], reach: float, out: Double
) -> None:
    """Writes the velocity of a robot without a place: away from the payload and its way.

    Args:
        robot: position first, [any].
        limits: radius, m, and maximum speed, m/s, first, [any].
        body: columns `states.BODY`, [7].
        way: unit vector of its way.
        reach: radius of a circle about the payload, m.
        out: written, see `follow_place`.
    """
    dx, dy = robot[0] - body[0], robot[1] - body[1]
    ahead, aside = dx * way[0] + dy * way[1], dy * way[0] - dx * way[1]
    room = reach + limits[0] + KEEP
    out[:] = 0.0
    out[2] = 0.1
    speed = 0.5 * limits[1]
    if 0.0 < ahead < AHEAD and abs(aside) < room:
        sign = speed if aside >= 0.0 else -speed
        out[0], out[1] = -sign * way[1], sign * way[0]
    elif dx * dx + dy * dy < room * room:
        d = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        out[0], out[1] = dx / d * speed, dy / d * speed


@kernel
def payload_half_plane(
    robot: Double, radius: float, body: Double, row: Float, planes: Double, n: int
) -> int:
    """Adds the velocities with which a robot does not run into the payload.

    Args:
        robot: position first, [any].
        radius: of the robot, m.
        body: columns `states.BODY`, [7].
        row: the payload as an obstacle, from `payload.place_row`, [8].
        planes: written from row n.
        n: how many half-planes there are already.

    Returns:
        How many there are now.
    """
    d, vx, vy = nearest(robot[0], robot[1], row)
    if not 0.0 < d < radius + 0.4:
        return n
    nx, ny = vx / d, vy / d
    bound = (d - radius - SURFACE_MARGIN) / BRAKE + body[2] * nx + body[3] * ny
    damper_half_plane(nx, ny, bound, planes[n])
    return n + 1


@kernel
def away_from_surfaces(
    body: Double, aim: tuple[float, float], reach: float, ground: tuple[Float, Double]
) -> tuple[float, float]:
    """The direction of `aim`, turned away from a surface that is near, as a unit vector.

    Args:
        body: columns `states.BODY`, [7].
        aim: where the payload should go, any length.
        reach: radius of a circle about the payload, m.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
    """
    x, y = body[0], body[1]
    grid, half = ground
    length = max(math.sqrt(aim[0] * aim[0] + aim[1] * aim[1]), 1e-9)
    wx, wy = aim[0] / length, aim[1] / length
    push = min(max(1.0 - (free_distance(x, y, grid, half) - reach) / SHY, 0.0), 1.0)
    if push > 0.0:
        e = 0.5 * SHY
        gx = free_distance(x + e, y, grid, half) - free_distance(x - e, y, grid, half)
        gy = free_distance(x, y + e, grid, half) - free_distance(x, y - e, grid, half)
        steep = max(math.sqrt(gx * gx + gy * gy), 1e-9)
        gx, gy = gx / steep, gy / steep
        turn = push * (SHYNESS - min(wx * gx + wy * gy, 0.0))
        wx, wy = wx + turn * gx, wy + turn * gy
        length = max(math.sqrt(wx * wx + wy * wy), 1e-9)
        wx, wy = wx / length, wy / length
    return wx, wy
