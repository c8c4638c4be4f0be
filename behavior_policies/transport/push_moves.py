"""How a robot of a pushing team moves: in its slot, on its way there, and out of the way.

Functions write its velocity, m/s, and a distance to go, for the right of way, m, to `out`.
"""

import math

from swarmdata.behavior_policies.navigation.avoidance import BRAKING_TIME, SURFACE_GAP
from swarmdata.behavior_policies.navigation.orca import damper_half_plane
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.behavior_policies.transport.payload_detour import Pushers, Rings, detour_waypoint
from swarmdata.behavior_policies.transport.push_setup import PayloadState, PushSetup
from swarmdata.behavior_policies.transport.push_team import (
    SLOT_GAP_TOLERANCE,
    SLOT_SIDE_TOLERANCE,
    WAITING_GAP,
)
from swarmdata.numerics.distance_field import PATH_GAP, Ground
from swarmdata.numerics.geometry import nearest
from swarmdata.numerics.waypoints import Paths, free_distance, waypoint
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float

FUNNEL_MAX_OFFSET = 0.25  # m beyond `WAITING_GAP` of a robot that is not beside its slot, at most
SURFACE_TURN_GAP, SURFACE_TURN_WEIGHT = 0.15, 0.2  # m to a surface below which paths turn; how much
KEEP_CLEAR_DISTANCE = 0.35  # m that robots without a slot keep from the payload and its path
KEEP_CLEAR_LENGTH = 1.5  # m of the payload's path that they keep clear


@kernel
def follow_slot(
    robot: Double,  # [C] x, y, vx, vy
    body: Double,  # [7] columns `state_layout.BODY`
    push: tuple[float, float, float, float],  # from `push_team.contact`
    force: float,  # N
    dt: float,  # control step, s
    out: Double,  # [3 or more] written, see the module
) -> None:
    """Writes the velocity of a robot in its slot: with the payload, and pushing by `force` N.

    A robot of mass 1 kg that commands a velocity `force * dt` above its own accelerates by `force`.
    """
    nx, ny, left, off = push
    ahead = body[2] * nx + body[3] * ny + APPROACH_RATE * off
    if force > 0.0:
        ahead = max(ahead, robot[2] * nx + robot[3] * ny + force * dt)
    side = body[3] * nx - body[2] * ny + APPROACH_RATE * left
    out[0], out[1], out[2] = ahead * nx - side * ny, ahead * ny + side * nx, 1.0


@kernel
def go_to_slot(
    i: int,
    setup: PushSetup,  # constants of payload and team
    payload: PayloadState,
    slot: Double,  # [4] of the robot
    pushers: Pushers,  # the team
    rings: Rings,  # from `payload_detour.fill_rings`
    ground: Ground,  # the free space
    paths: Paths,  # of the robots to the payload, for robots that do not see it
    out: Double,  # [3 or more] written, see the module
) -> None:
    """Writes the velocity of robot i on its way to its slot, by `paths` if that is hidden."""
    robot, radius = pushers.robots[i], setup.radii[i]
    x, y, nx, ny = robot[0], robot[1], slot[2], slot[3]
    dx, dy = slot[0] - x, slot[1] - y
    along, off = dy * nx - dx * ny, dx * nx + dy * ny
    to_x, to_y = slot[0], slot[1]
    if abs(along) >= SLOT_SIDE_TOLERANCE or not -SLOT_GAP_TOLERANCE < off < 0.3:
        back = WAITING_GAP + min(abs(along), FUNNEL_MAX_OFFSET)  # straight in, between others
        to_x, to_y = slot[0] - back * nx, slot[1] - back * ny
        if free_distance(to_x, to_y, ground) < radius + PATH_GAP:
            to_x, to_y = slot[0] - WAITING_GAP * nx, slot[1] - WAITING_GAP * ny
        end = (to_x, to_y)
        found, to_x, to_y = detour_waypoint(i, pushers, end, payload, radius, ground, rings)
        if not found:
            to_x, to_y = waypoint((x, y), payload.body[:2], radius, ground, paths)
    dx, dy = to_x - x, to_y - y
    d = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    sx, sy = slot[0] - x, slot[1] - y
    left = math.sqrt(sx * sx + sy * sy)
    speed = min(setup.max_speeds[i], APPROACH_RATE * left)
    out[0], out[1], out[2] = dx / d * speed, dy / d * speed, 1.0


@kernel
def keep_clear(
    i: int,
    robot: Double,  # [C] position first
    setup: PushSetup,  # constants of payload and team
    body: Double,  # [7] columns `state_layout.BODY`
    direction: tuple[float, float],  # unit vector of the payload's path
    out: Double,  # [3 or more] written, see the module
) -> None:
    """Writes the velocity of a robot without a slot: away from the payload and its path."""
    dx, dy, shape = robot[0] - body[0], robot[1] - body[1], setup.shape
    ahead, aside = dx * direction[0] + dy * direction[1], dy * direction[0] - dx * direction[1]
    reach = math.sqrt(shape[1] * shape[1] + shape[2] * shape[2])
    room = reach + setup.radii[i] + KEEP_CLEAR_DISTANCE
    out[:] = 0.0
    out[2] = 0.1
    speed = 0.5 * setup.max_speeds[i]
    if 0.0 < ahead < KEEP_CLEAR_LENGTH and abs(aside) < room:
        sign = speed if aside >= 0.0 else -speed
        out[0], out[1] = -sign * direction[1], sign * direction[0]
    elif dx * dx + dy * dy < room * room:
        d = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        out[0], out[1] = dx / d * speed, dy / d * speed


@kernel
def payload_half_plane(
    robot: Double, radius: float, body: Double, row: Float, planes: Double, n: int
) -> int:
    """Adds velocities with which a robot does not run into the payload; returns the rows so far.

    `row`: the payload as an obstacle, from `payload.place_row`, [8]. `planes` [K, 4] are written
    from row n.
    """
    d, vx, vy = nearest(robot[0], robot[1], row)
    if not 0.0 < d < radius + 0.4:
        return n
    nx, ny = vx / d, vy / d
    bound = (d - radius - SURFACE_GAP) / BRAKING_TIME + body[2] * nx + body[3] * ny
    damper_half_plane(nx, ny, bound, planes[n])
    return n + 1


@kernel
def away_from_surfaces(
    body: Double, aim: tuple[float, float], reach: float, ground: Ground
) -> tuple[float, float]:
    """The direction of `aim`, turned away from a surface that is near, as a unit vector.

    `aim`: wanted displacement of the payload, of any length. `reach`: radius of a circle about the
    payload, m.
    """
    x, y = body[0], body[1]
    length = max(math.sqrt(aim[0] * aim[0] + aim[1] * aim[1]), 1e-9)
    wx, wy = aim[0] / length, aim[1] / length
    gap = free_distance(x, y, ground) - reach
    push = min(max(1.0 - gap / SURFACE_TURN_GAP, 0.0), 1.0)
    if push > 0.0:
        e = 0.5 * SURFACE_TURN_GAP
        gx = free_distance(x + e, y, ground) - free_distance(x - e, y, ground)
        gy = free_distance(x, y + e, ground) - free_distance(x, y - e, ground)
        steep = max(math.sqrt(gx * gx + gy * gy), 1e-9)
        gx, gy = gx / steep, gy / steep
        turn = push * (SURFACE_TURN_WEIGHT - min(wx * gx + wy * gy, 0.0))
        wx, wy = wx + turn * gx, wy + turn * gy
        length = max(math.sqrt(wx * wx + wy * wy), 1e-9)
        wx, wy = wx / length, wy / length
    return wx, wy
