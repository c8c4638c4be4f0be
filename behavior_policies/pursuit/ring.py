"""A ring: robots surround an evader from outside the distance at which it flees, then close in.

Slots lie on a circle of `RING_RADIUS`, evenly over the directions that walls and obstacles leave
open. Robots take them in the order in which they stand around the evader, so that the longest way
and a share of the sum of all ways are least, and travel along the circle. They close in once no
open direction is farther than `CLOSE_COS` from all of them, or all have been at their slots for
`PATIENCE_STEPS`; and open again when one is far from them. Angles are compared by their cosines.
`place` [2] is that of the evader, m; `members` [Q, 2] are those of the robots.
"""

import math

import numpy as np

from swarmdata.behavior_policies.pursuit.beliefs import Hunt
from swarmdata.numerics.geometry import clearance
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double, Float, Int

N_DIRECTIONS = 48  # directions around an evader
RING_RADIUS = 0.95  # m from the evader at which robots wait: beyond `evader.ALARM_DISTANCE`
GUARD_MARGIN = 0.25  # m beyond the ring from which a robot guards a direction

CLOSE_COS, OPEN_COS = 0.3153223623952687, -0.32328956686350335
"""Cosines of the largest angle between an open direction and the nearest robot for which they
close in, 1.25 rad, and from which they open again, 1.9 rad."""

FILL_DISTANCE = 0.3  # m from its slot within which a robot is there
PATIENCE_STEPS, COMMITTED_STEPS = 8, 12  # waiting at their slots; closing in at least
TRAVEL_COS, TRAVEL_SIN = 0.8253356149096783, 0.5646424733950354  # of 0.6 rad, by which they travel
OUTER_MARGIN = 0.3  # m outside the circle from which robots still travel along theirs

CLOSE_RADIUS, CLOSE_LEAD = 0.25, 0.3
"""Radius (m) of the slots to which they close in, around the place ahead of the evader by this
time (s)."""

STRAIGHT_DISTANCE, STRAIGHT_LEAD = 0.55, 0.15  # m; s ahead of the evader where they drive within it
N_PHASES = 6  # rotations of the slots that are compared
CLOSED_WEIGHT = 0.12  # share of the robots that a closed direction gets, of what an open one does

SUM_WEIGHT, PHASE_COST = 0.2, 3.0
"""Cost of assignments: of the sum of all ways, beside the longest; and, where something closes
directions, of slots that are not in the middle of their shares, m."""

GAP_REACH = 0.45  # m from an evader at which a direction has to be open for it to leave there
N_RADII, LEAST_RADIUS = 5, 0.15  # free places along a direction, from this share of the radius on
_WINDOW = 4  # directions on each side that count for how closed one is


@kernel
def find_open(place: Double, radius: float, layout: Float, hunt: Hunt, out: Bool) -> bool:
    """Writes which directions around an evader are open up to a radius, [D]; returns if all are."""
    are_all = True
    for d in range(out.shape[0]):
        out[d] = True
        for r in range(N_RADII):
            share = LEAST_RADIUS + (1.0 - LEAST_RADIUS) * r / (N_RADII - 1.0)
            x = place[0] + share * radius * hunt.directions[d, 0]
            y = place[1] + share * radius * hunt.directions[d, 1]
            if clearance(x, y, layout, hunt.half) <= hunt.radius:
                out[d], are_all = False, False
                break
    return are_all


@kernel
def most_closed(are_open: Bool) -> int:
    """The direction with the fewest open ones around it."""
    n, best, least = are_open.shape[0], 0, are_open.shape[0]
    for d in range(n):
        count = 0
        for k in range(-_WINDOW, _WINDOW + 1):
            count += are_open[(d + k) % n]
        if count < least:
            best, least = d, count
    return best


@kernel
def turn_order(place: Double, members: Double) -> Int:
    """The members in the order in which they stand around a place, counter-clockwise, [Q]."""
    q = members.shape[0]
    order, keys = np.empty(q, np.int64), np.empty(q)
    for m in range(q):
        x, y = members[m, 0] - place[0], members[m, 1] - place[1]
        share = x / max(abs(x) + abs(y), 1e-9)
        key, at = (1.0 - share if y >= 0.0 else 3.0 + share), m
        while at > 0 and keys[at - 1] > key:
            keys[at], order[at] = keys[at - 1], order[at - 1]
            at -= 1
        keys[at], order[at] = key, m
    return order


@kernel
def write_slots(
    place: Double, phase: float, first: int, shares: Double, radius: float, hunt: Hunt, out: Double
) -> None:
    """Writes slots around an evader at a radius (m), counter-clockwise, m, [Q, 2].

    `phase`: where in its share of the directions each slot is, from 0 to 1. `first`: the direction
    at which the first share begins. `shares`: of the directions from the first one on, summed, [D].
    """
    n, d = shares.shape[0], 0
    for s in range(out.shape[0]):
        wanted = (s + phase) / out.shape[0] + 1e-9
        while d < n - 1 and shares[d] < wanted:
            d += 1
        direction = hunt.directions[(first + d) % n]
        for axis in range(2):
            room = hunt.half[axis] - hunt.radius
            out[s, axis] = min(max(place[axis] + radius * direction[axis], -room), room)


@kernel
def assign_slots(
    place: Double, members: Double, radius: float, layout: Float, hunt: Hunt, out: Double
) -> None:
    """Writes the slot of each member on a ring of this radius (m) around an evader, m, [Q, 2].

    `layout`: obstacles, [M, 8].
    """
    n, q, least = hunt.directions.shape[0], members.shape[0], math.inf
    are_open, shares, slots = np.empty(n, np.bool_), np.empty(n), np.empty((q, 2))
    are_all_open = find_open(place, radius, layout, hunt, are_open)
    first, total = most_closed(are_open), 0.0
    for d in range(n):
        total += 1.0 if are_open[(first + d) % n] else CLOSED_WEIGHT
        shares[d] = total
    shares /= total
    order = turn_order(place, members)
    for p in range(N_PHASES):
        phase = p / N_PHASES
        write_slots(place, phase, first, shares, radius, hunt, slots)
        for shift in range(q):
            longest, cost = 0.0, 0.0 if are_all_open else PHASE_COST * abs(phase - 0.5)
            for m in range(q):
                slot = (m + shift) % q
                x, y = members[order[m], 0] - slots[slot, 0], members[order[m], 1] - slots[slot, 1]
                way = math.sqrt(x * x + y * y)
                longest, cost = max(longest, way), cost + SUM_WEIGHT * way
            if cost + longest < least:
                least = cost + longest
                for m in range(q):
                    out[order[m]] = slots[(m + shift) % q]


@kernel
def guarded_cos(place: Double, members: Double, layout: Float, hunt: Hunt) -> float:
    """Cosine of the largest angle from an open direction to the nearest guard; 1 without any."""
    least, reach = 1.0, RING_RADIUS + GUARD_MARGIN
    for d in range(hunt.directions.shape[0]):
        ux, uy = hunt.directions[d, 0], hunt.directions[d, 1]
        x, y = place[0] + GAP_REACH * ux, place[1] + GAP_REACH * uy
        if clearance(x, y, layout, hunt.half) <= hunt.radius:
            continue
        nearest = -1.0
        for m in range(members.shape[0]):
            wx, wy = members[m, 0] - place[0], members[m, 1] - place[1]
            length = math.sqrt(wx * wx + wy * wy)
            if length < reach:
                nearest = max(nearest, (wx * ux + wy * uy) / max(length, 1e-9))
        least = min(least, nearest)
    return least


@kernel
def decides_to_close(is_closing: bool, wait: int, cos: float, is_filled: bool) -> tuple[bool, int]:
    """Whether the ring closes in, and how long it has waited, or, below 0, been closing in."""
    if is_closing:
        wait = min(wait - 1, 0)
        return cos > OPEN_COS or wait > -COMMITTED_STEPS, wait
    wait = wait + 1 if is_filled else 0
    if cos > CLOSE_COS or wait >= PATIENCE_STEPS:
        return True, 0
    return False, wait


@kernel
def travel(place: Double, member: Double, slot: Double, hunt: Hunt, out: Double) -> None:
    """Writes where a robot drives to on its way to its slot: along the circle, or to the slot."""
    x, y = member[0] - place[0], member[1] - place[1]
    sx, sy = slot[0] - place[0], slot[1] - place[1]
    d = max(math.sqrt(x * x + y * y), 1e-9)
    length = max(d * math.sqrt(sx * sx + sy * sy), 1e-9)
    out[0], out[1] = slot[0], slot[1]
    if (x * sx + y * sy) / length >= TRAVEL_COS:
        return
    sin = TRAVEL_SIN if x * sy - y * sx > 0.0 else -TRAVEL_SIN
    radius = max(RING_RADIUS, min(d, RING_RADIUS + OUTER_MARGIN)) / d
    wx, wy = radius * (TRAVEL_COS * x - sin * y), radius * (sin * x + TRAVEL_COS * y)
    room_x, room_y = hunt.half[0] - hunt.radius, hunt.half[1] - hunt.radius
    out[0] = min(max(place[0] + wx, -room_x), room_x)
    out[1] = min(max(place[1] + wy, -room_y), room_y)


@kernel
def ring_goals(
    place: Double,  # [2] of the evader, m
    velocity: Double,  # [2] of the evader, m/s
    members: Double,  # [Q, 2] places of the robots, m
    phase: tuple[bool, int],  # what this returned in the step before; (False, 0) at first
    layout: Float,  # [M, 8] obstacles
    hunt: Hunt,  # constants
    goals: Double,  # [Q, 2] written, m
) -> tuple[bool, int]:
    """Writes where a ring's robots drive; returns whether it closes in, and steps it has waited."""
    q = members.shape[0]
    slots, is_filled = np.empty((q, 2)), True
    assign_slots(place, members, RING_RADIUS, layout, hunt, slots)
    for m in range(q):
        x, y = members[m, 0] - slots[m, 0], members[m, 1] - slots[m, 1]
        is_filled = is_filled and x * x + y * y < FILL_DISTANCE * FILL_DISTANCE
    cos = guarded_cos(place, members, layout, hunt)
    is_closing, wait = decides_to_close(phase[0], phase[1], cos, is_filled)
    if not is_closing:
        for m in range(q):
            travel(place, members[m], slots[m], hunt, goals[m])
        return is_closing, wait
    ahead = place + CLOSE_LEAD * velocity
    assign_slots(ahead, members, CLOSE_RADIUS, layout, hunt, goals)
    for m in range(q):
        x, y = members[m, 0] - place[0], members[m, 1] - place[1]
        if x * x + y * y < STRAIGHT_DISTANCE * STRAIGHT_DISTANCE:
            goals[m, 0] = place[0] + STRAIGHT_LEAD * velocity[0]
            goals[m, 1] = place[1] + STRAIGHT_LEAD * velocity[1]
    return is_closing, wait
