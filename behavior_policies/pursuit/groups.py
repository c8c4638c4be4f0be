"""Who goes where: groups of robots, each around one evader, and robots that search.

An evader gets as many of the nearest robots as capture it, the evader first whose robots are
nearest of all. Groups stay until another evader becomes known, or one is captured or lost. Robots
without a group search, each in its own sector of the arena, while an evader is unknown.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.behavior_policies.pursuit.beliefs import Beliefs, Hunt, is_known
from swarmdata.behavior_policies.pursuit.ring import ring_goals
from swarmdata.numerics.random import STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double, Float, Int

NO_GROUP = -1

SEARCH_TIME = 6.0  # seconds after which a robot searches elsewhere
ARRIVED_DISTANCE = 0.4  # m from where it searches within which a robot has arrived

SEARCH_SHARES = (0.15, 1.0)
"""Smallest and largest square of the distance from the middle at which robots search, as a share
of that of the walls."""

SEARCH_SCALE, SEARCH_ROOM = 1.2, 0.3  # stretch of that towards the corners; room to walls, m

_STREAM = STREAMS["policy"]


class Plans(NamedTuple):
    """What a team has in mind in one episode, by view (`beliefs`)."""

    groups: Int  # [V, N] evader of each robot's group, or `NO_GROUP`
    grouped_for: Bool  # [V, K] evaders that were known when groups were formed
    are_closing: Bool  # [V, K] rings that close in
    waits: Int  # [V, K] control steps for which rings have waited, or closed in (below 0)
    search_places: Double  # [N, 2] m, where robots search
    search_ends: Int  # [N] control step until which they do


@kernel
def form_groups(v: int, hunt: Hunt, beliefs: Beliefs, plans: Plans) -> None:
    """Forms the groups of view v anew if the known evaders are not those of the last groups."""
    n_evaders, has_changed = beliefs.ages.shape[1], False
    for k in range(n_evaders):
        is_now = is_known(beliefs, v, k)
        if is_now != plans.grouped_for[v, k]:
            plans.grouped_for[v, k], has_changed = is_now, True
            plans.are_closing[v, k], plans.waits[v, k] = False, 0
    if not has_changed:
        return
    plans.groups[v] = NO_GROUP
    is_served = np.zeros(n_evaders, np.bool_)
    for _ in range(n_evaders):
        best, least = NO_GROUP, math.inf
        for k in range(n_evaders):
            if plans.grouped_for[v, k] and not is_served[k]:
                total = gather(v, k, hunt, beliefs, plans, False)
                if total < least:
                    best, least = k, total
        if best != NO_GROUP:
            gather(v, best, hunt, beliefs, plans, True)
            is_served[best] = True


@kernel
def gather(v: int, k: int, hunt: Hunt, beliefs: Beliefs, plans: Plans, is_final: bool) -> float:
    """The sum of the distances from evader k to the nearest robots without a group, m.

    They become its group if `is_final`. Infinity if there are too few.
    """
    n, total = beliefs.mates.shape[1], 0.0
    is_taken = np.zeros(n, np.bool_)
    for _ in range(hunt.captors):
        best, least = -1, math.inf
        for i in range(n):
            x = beliefs.mates[v, i, 0] - beliefs.places[v, k, 0]
            y = beliefs.mates[v, i, 1] - beliefs.places[v, k, 1]
            d = math.sqrt(x * x + y * y)
            if plans.groups[v, i] == NO_GROUP and not is_taken[i] and d < least:
                best, least = i, d
        if best < 0:
            return math.inf
        is_taken[best] = True
        total += least
    for i in range(n if is_final else 0):
        if is_taken[i]:
            plans.groups[v, i] = k
    return total


@kernel
def search_place(
    i: int, seed: np.uint64, time: int, place: Double, hunt: Hunt, plans: Plans, out: Double
) -> None:
    """Writes where robot i searches, m, [2]; a new place in its sector once it has been there."""
    at, n = plans.search_places[i], plans.search_ends.shape[0]
    x, y = at[0] - place[0], at[1] - place[1]
    if time >= plans.search_ends[i] or x * x + y * y < ARRIVED_DISTANCE * ARRIVED_DISTANCE:
        bits = absorb(absorb(absorb(seed, _STREAM), time), i)
        turn = (i + to_uniform(absorb(bits, 0))) / n
        low, high = SEARCH_SHARES
        square = low + (high - low) * to_uniform(absorb(bits, 1))
        direction = hunt.directions[int(turn * hunt.directions.shape[0])]
        for axis in range(2):
            room = hunt.half[axis] - SEARCH_ROOM
            far = SEARCH_SCALE * math.sqrt(square) * hunt.half[axis] * direction[axis]
            at[axis] = min(max(far, -room), room)
        plans.search_ends[i] = time + round(SEARCH_TIME / hunt.dt)
    out[0], out[1] = at[0], at[1]


@kernel
def goals_of_rings(
    v: int, layout: Float, hunt: Hunt, beliefs: Beliefs, plans: Plans, goals: Double
) -> None:
    """Writes where the robots in groups drive to, as view v decides, m, [N, 2]."""
    n = beliefs.mates.shape[1]
    for k in range(beliefs.ages.shape[1]):
        count = 0
        members, found, own = np.empty((n, 2)), np.empty((n, 2)), np.empty(n, np.int64)
        for i in range(n):
            if plans.groups[v, i] == k:
                members[count], own[count] = beliefs.mates[v, i], i
                count += 1
        if count == 0:
            continue
        phase = (bool(plans.are_closing[v, k]), int(plans.waits[v, k]))
        place, velocity = beliefs.places[v, k], beliefs.velocities[v, k]
        plans.are_closing[v, k], plans.waits[v, k] = ring_goals(
            place, velocity, members[:count], phase, layout, hunt, found[:count]
        )
        for m in range(count):
            goals[own[m]] = found[m]


@kernel
def goals_of_chases(v: int, leads: Double, hunt: Hunt, beliefs: Beliefs, goals: Double) -> Bool:
    """Writes where robots drive to that chase the nearest evader, m, [N, 2]; returns which do, [N].

    `leads`: of each robot, share of its time to the evader, and largest time (s), by which it aims
    ahead, [N, 2].
    """
    n = beliefs.mates.shape[1]
    chases = np.zeros(n, np.bool_)
    for i in range(n):
        least = math.inf
        for k in range(beliefs.ages.shape[1]):
            place, velocity = beliefs.places[v, k], beliefs.velocities[v, k]
            x, y = place[0] - beliefs.mates[v, i, 0], place[1] - beliefs.mates[v, i, 1]
            d = math.sqrt(x * x + y * y)
            if not is_known(beliefs, v, k) or d >= least:
                continue
            least, chases[i] = d, True
            lead = min(leads[i, 0] * d / hunt.speed, leads[i, 1])
            for axis in range(2):
                room = hunt.half[axis] - hunt.radius
                ahead = place[axis] + lead * velocity[axis]
                goals[i, axis] = min(max(ahead, -room), room)
    return chases


@kernel
def choose_goals(
    seed: np.uint64,  # of the episode
    time: int,  # control step
    layout: Float,  # [M, 8] obstacles
    leads: Double,  # [N, 2] of robots that chase (`goals_of_chases`); [0, 2] for rings
    hunt: Hunt,  # constants
    beliefs: Beliefs,  # of the robots
    plans: Plans,  # of the robots; changed
    goals: Double,  # [N, 2] written, m
) -> None:
    """Writes where the robots of one episode drive to."""
    n, n_views = goals.shape[0], beliefs.ages.shape[0]
    decided = np.empty((n, 2))
    for v in range(n_views):
        if leads.shape[0] > 0:
            is_busy = goals_of_chases(v, leads, hunt, beliefs, decided)
        else:
            form_groups(v, hunt, beliefs, plans)
            goals_of_rings(v, layout, hunt, beliefs, plans, decided)
            is_busy = plans.groups[v] != NO_GROUP
        is_all_known = True
        for k in range(beliefs.ages.shape[1]):
            is_all_known = is_all_known and (is_known(beliefs, v, k) or beliefs.are_gone[v, k])
        for i in range(n):
            if n_views > 1 and i != v:
                continue
            if is_busy[i]:
                goals[i] = decided[i]
            elif is_all_known:
                goals[i] = beliefs.mates[v, i]
            else:
                search_place(i, seed, time, beliefs.mates[v, i], hunt, plans, goals[i])


def blank_plans(n_copies: int, n_views: int, n_agents: int, n_evaders: int) -> Plans:
    """Plans of E copies with nothing in them; each field has a leading axis E."""
    return Plans(
        groups=np.full((n_copies, n_views, n_agents), NO_GROUP, dtype=np.int64),
        grouped_for=np.zeros((n_copies, n_views, n_evaders), dtype=np.bool_),
        are_closing=np.zeros((n_copies, n_views, n_evaders), dtype=np.bool_),
        waits=np.zeros((n_copies, n_views, n_evaders), dtype=np.int64),
        search_places=np.zeros((n_copies, n_agents, 2)),
        search_ends=np.zeros((n_copies, n_agents), dtype=np.int64),
    )
