"""Where robots push a payload from: places along the faces that point against its way.

A face is numbered by the push it takes in the payload's frame: 0 along +x (the face on the -x
side), 1 along -x, 2 along +y, 3 along -y. Circular payloads have no faces; robots stand on an arc
behind them.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

from swarmdata.behavior_policies.navigation.planner import free_distance
from swarmdata.envs.transport.payload import Shape
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float

MAX_SLOTS = 16
"""Most places at a payload."""

ELBOW = 0.06
"""Gap (m) between robots that push side by side."""

EDGE = 0.04
"""Distance (m) of a contact point to the end of its face."""

CUT = 0.1
"""Metres at the end of a face that are free for the robots around the corner."""

BEHIND = 0.05
"""Gap (m) to surfaces that a robot at a place must have."""

SIDE, SIDE_KEPT = 0.2, 0.08
"""Cosines of way and push above which a second face is used, and kept."""

KEEP = 0.15
"""Cosine by which another first face must be better."""

ARC = 0.45
"""Least cosine between the way and a push at a circle."""

NONE = -1


@kernel
def face_normal(body: Double, face: int) -> tuple[float, float]:
    """Direction of the push that a face takes, in the world's frame.

    Args:
        body: columns `states.BODY`, [7].
        face: its number.
    """
    ux, uy = body[4], body[5]
    nx, ny = (ux, uy) if face < 2 else (-uy, ux)
    return (nx, ny) if face % 2 == 0 else (-nx, -ny)


@kernel
def fill_face(
    body: Double,
    shape: Shape,
    faces: tuple[int, int],
    radius: float,
    most: int,
    ground: tuple[Float, Double],
    out: Double,
) -> int:
    """Writes up to `most` places at a face where a robot has room; returns how many.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        faces: the face, and the face around the corner at which robots push too, or `NONE`.
        radius: of the robots, m.
        most: how many.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        out: written: a robot's centre (m) when it touches, and the direction of its push, [any, 4].
    """
    face, other = faces
    nx, ny = face_normal(body, face)
    tx, ty = (-body[5], body[4]) if face < 2 else (body[4], body[5])
    depth, extent = (shape[1], shape[2]) if face < 2 else (shape[2], shape[1])
    low, high = EDGE - extent, extent - EDGE
    if other != NONE:
        if other % 2 == 0:  # it pushes along +, so its robots are at the - end
            low += CUT
        else:
            high -= CUT
    length = max(high - low, 0.0)
    n = min(int(length / (2.0 * radius + ELBOW) + 1e-9) + 1, most)
    spacing = length / (n - 1) if n > 1 else 0.0
    middle = 0.5 * (low + high) if n > 1 else min(max(0.0, low), high)
    found = 0
    for k in range(n):
        lever = middle + (k - 0.5 * (n - 1)) * spacing
        x = body[0] - nx * (depth + radius) + tx * lever
        y = body[1] - ny * (depth + radius) + ty * lever
        if free_distance(x, y, ground[0], ground[1]) >= radius + BEHIND:
            out[found, 0], out[found, 1], out[found, 2], out[found, 3] = x, y, nx, ny
            found += 1
    return found


@kernel
def fill_arc(
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    radius: float,
    most: int,
    ground: tuple[Float, Double],
    out: Double,
) -> int:
    """Writes up to `most` places behind a circular payload; as `fill_face`.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        way: unit vector of its way.
        radius: of the robots, m.
        most: how many; no more than `ARC` allows.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        out: written, [any, 4].
    """
    reach = shape[1] + radius
    h = (radius + 0.5 * ELBOW) / reach  # sine of half the angle between two neighbors
    c, n = math.sqrt(1.0 - h * h), most
    while True:  # the first robot's direction, turned back from the way by n - 1 half angles
        nx, ny = way
        for _ in range(n - 1):
            nx, ny = nx * c + ny * h, ny * c - nx * h
        if n == 1 or ((nx * way[0] + ny * way[1]) >= ARC and (n - 1) * h < 2.0):
            break
        n -= 1
    found = 0
    for _ in range(n):
        x, y = body[0] - nx * reach, body[1] - ny * reach
        if free_distance(x, y, ground[0], ground[1]) >= radius + BEHIND:
            out[found, 0], out[found, 1], out[found, 2], out[found, 3] = x, y, nx, ny
            found += 1
        for _ in range(2):
            nx, ny = nx * c - ny * h, ny * c + nx * h
    return found


@kernel
def _score(body: Double, face: int, way: tuple[float, float]) -> float:
    nx, ny = face_normal(body, face)
    return nx * way[0] + ny * way[1]


@kernel
def _first_face(
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    before: int,
    team: tuple[int, float, float],
    ground: tuple[Float, Double],
    out: Double,
) -> int:
    """The face that points best along the way, of those with room for enough robots."""
    best, first = -1e9, NONE
    for face in range(4):
        score = _score(body, face, way) + (KEEP if face == before else 0.0)
        if score <= best:
            continue
        n = fill_face(body, shape, (face, NONE), team[1], team[0], ground, out)
        if n >= min(team[2], 1.0 * team[0]):
            best, first = score, face
    return first


@kernel
def choose_slots(
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    before: tuple[int, int],
    team: tuple[int, float, float],
    ground: tuple[Float, Double],
    out: Double,
) -> tuple[int, int, int]:
    """Chooses the one or two faces to push at, and the places at them.

    The first face is the one that points best along the way, the second its better neighbor, if
    the way points at it at all and the robots at both can push along the way; else they push at
    the first alone, and the way will turn. What was chosen before is kept when about as good, since
    robots have to move for a change.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        way: unit vector of its way.
        before: faces of the step before, or `NONE`.
        team: number of robots, their largest radius, m, and how many times a robot's force it takes
            to move the payload.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        out: written, see `fill_face`, [MAX_SLOTS, 4].

    Returns:
        First face, second face or `NONE`, and the number of places.
    """
    n, radius = min(team[0], MAX_SLOTS), team[1]
    if shape[0] == CIRCLE:
        return 0, NONE, fill_arc(body, shape, way, radius, n, ground, out)
    first = _first_face(body, shape, way, before[0], team, ground, out)
    if first == NONE:
        return NONE, NONE, 0
    near = 2 - 2 * (first // 2)  # the lower number of its neighbors
    second = near if _score(body, near, way) > _score(body, near + 1, way) else near + 1
    if second == before[0] and first == before[1]:  # the same faces; their order is no matter
        first, second = second, first
    aside, ahead = _score(body, second, way), _score(body, first, way)
    if min(aside, ahead) > (SIDE_KEPT if (first, second) == before else SIDE):
        found = fill_face(body, shape, (second, first), radius, n // 2, ground, out)
        rest = fill_face(body, shape, (first, second), radius, n - found, ground, out[found:])
        if found >= team[2] * aside and rest >= team[2] * ahead:
            return first, second, found + rest
    return first, NONE, fill_face(body, shape, (first, NONE), radius, n, ground, out)
