"""Slots from which robots push a payload, along the faces that point against its direction.

A face is numbered by the push it takes in the payload's frame: 0 along +x (the face on the -x
side), 1 along -x, 2 along +y, 3 along -y. Slots of circles are on an arc behind them. A slot is a
row: a robot's centre (m) when it touches, and the direction of its push.
"""

import math
from typing import NamedTuple

from swarmdata.behavior_policies.transport.push_setup import PayloadState
from swarmdata.numerics.distance_field import Ground
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.waypoints import free_distance
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

MAX_SLOTS = 16  # most slots at a payload
NEIGHBOR_GAP = 0.06  # gap (m) between robots that push side by side
FACE_END_DISTANCE = 0.04  # distance (m) of a contact point to the end of its face
CORNER_CLEARANCE = 0.1  # m at the end of a face that are free for the robots around the corner
SLOT_SURFACE_GAP = 0.05  # gap (m) to surfaces that a robot in a slot must have

SECOND_FACE_MIN_COSINE, SECOND_FACE_KEPT_COSINE = 0.2, 0.08
"""Cosines of direction and push above which a second face is used, and above which it is kept."""

FIRST_FACE_KEPT_COSINE = 0.15  # increase of the cosine for which the first face changes
ARC_MIN_COSINE = 0.45  # least cosine between the direction and a push at a circle
NO_INDEX = -1  # stands for the number of a face or slot where there is none


class SlotSearch(NamedTuple):
    """What slots are searched for: a payload, its direction, its surroundings and its team."""

    payload: PayloadState
    direction: tuple[float, float]  # unit vector of the payload's path
    ground: Ground
    n_robots: int
    radius: float  # m, of the largest robot
    n_needed: float  # robots whose forces together move the payload


@kernel
def face_normal(body: Double, face: int) -> tuple[float, float]:
    """Direction of the push that a face takes, a unit vector, by the payload's `body` [7]."""
    ux, uy = body[4], body[5]
    nx, ny = (ux, uy) if face < 2 else (-uy, ux)
    return (nx, ny) if face % 2 == 0 else (-nx, -ny)


@kernel
def _add_slot(
    search: SlotSearch, x: float, y: float, nx: float, ny: float, out: Double, n: int
) -> int:
    """Writes a slot to row n if a robot has room there; returns the number of slots."""
    if free_distance(x, y, search.ground) >= search.radius + SLOT_SURFACE_GAP:
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = x, y, nx, ny
        n += 1
    return n


@kernel
def fill_face(search: SlotSearch, face: int, other: int, limit: int, out: Double) -> int:
    """Writes up to `limit` slots at a face where a robot has room; returns their number.

    `other`: the face around the corner at which robots push too, or `NO_INDEX`.
    """
    (body, shape), radius = search.payload, search.radius
    nx, ny = face_normal(body, face)
    tx, ty = (-body[5], body[4]) if face < 2 else (body[4], body[5])
    depth, extent = (shape[1], shape[2]) if face < 2 else (shape[2], shape[1])
    low, high = FACE_END_DISTANCE - extent, extent - FACE_END_DISTANCE
    if other != NO_INDEX:
        if other % 2 == 0:  # it pushes along +, so its robots are at the - end
            low += CORNER_CLEARANCE
        else:
            high -= CORNER_CLEARANCE
    length = max(high - low, 0.0)
    n = min(int(length / (2.0 * radius + NEIGHBOR_GAP) + 1e-9) + 1, limit)
    spacing = length / (n - 1) if n > 1 else 0.0
    middle = 0.5 * (low + high) if n > 1 else min(max(0.0, low), high)
    found = 0
    for k in range(n):
        lever = middle + (k - 0.5 * (n - 1)) * spacing
        x = body[0] - nx * (depth + radius) + tx * lever
        y = body[1] - ny * (depth + radius) + ty * lever
        found = _add_slot(search, x, y, nx, ny, out, found)
    return found


@kernel
def fill_arc(search: SlotSearch, limit: int, out: Double) -> int:
    """Writes up to `limit` slots behind a circular payload, as `fill_face` does at a face."""
    (body, shape), direction, radius = search.payload, search.direction, search.radius
    reach = shape[1] + radius
    h = (radius + 0.5 * NEIGHBOR_GAP) / reach  # sine of half the angle between two neighbors
    c, n = math.sqrt(1.0 - h * h), limit
    while True:  # the first robot's direction, turned back from the payload's by n - 1 half angles
        nx, ny = direction
        for _ in range(n - 1):
            nx, ny = nx * c + ny * h, ny * c - nx * h
        cosine = nx * direction[0] + ny * direction[1]
        if n == 1 or (cosine >= ARC_MIN_COSINE and (n - 1) * h < 2.0):
            break
        n -= 1
    found = 0
    for _ in range(n):
        x, y = body[0] - nx * reach, body[1] - ny * reach
        found = _add_slot(search, x, y, nx, ny, out, found)
        for _ in range(2):
            nx, ny = nx * c - ny * h, ny * c + nx * h
    return found


@kernel
def _face_cosine(search: SlotSearch, face: int) -> float:
    nx, ny = face_normal(search.payload.body, face)
    return nx * search.direction[0] + ny * search.direction[1]


@kernel
def choose_slots(search: SlotSearch, before: tuple[int, int], out: Double) -> tuple[int, int, int]:
    """Chooses the one or two faces to push at, and the slots at them, [MAX_SLOTS, 4].

    The first face points best along the direction and has room for enough robots. The second is its
    better neighbor, if the robots at both can push along the direction. An earlier choice,
    `before`, is kept while it is about as good, since robots have to move for a change.

    Returns:
        First face, second face or `NO_INDEX`, and the number of slots.
    """
    n, n_needed = min(search.n_robots, MAX_SLOTS), search.n_needed
    if search.payload.shape[0] == CIRCLE:
        return 0, NO_INDEX, fill_arc(search, n, out)
    best, first = -1e9, NO_INDEX
    for face in range(4):
        cosine = _face_cosine(search, face)
        cosine += FIRST_FACE_KEPT_COSINE if face == before[0] else 0.0
        if cosine <= best:
            continue
        if fill_face(search, face, NO_INDEX, n, out) >= min(n_needed, 1.0 * n):
            best, first = cosine, face
    if first == NO_INDEX:
        return NO_INDEX, NO_INDEX, 0
    near = 2 - 2 * (first // 2)  # the lower number of its neighbors
    second = near if _face_cosine(search, near) > _face_cosine(search, near + 1) else near + 1
    if second == before[0] and first == before[1]:  # the same faces in the order of before
        first, second = second, first
    aside, ahead = _face_cosine(search, second), _face_cosine(search, first)
    is_kept = (first, second) == before
    if min(aside, ahead) > (SECOND_FACE_KEPT_COSINE if is_kept else SECOND_FACE_MIN_COSINE):
        found = fill_face(search, second, first, n // 2, out)
        rest = fill_face(search, first, second, n - found, out[found:])
        if found >= n_needed * aside and rest >= n_needed * ahead:
            return first, second, found + rest
    return first, NO_INDEX, fill_face(search, first, NO_INDEX, n, out)
