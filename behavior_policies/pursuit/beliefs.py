"""What a pursuer believes: where the evaders and its teammates are, from sight and messages.

A team that sees everything has one view, and is right. Otherwise each robot has its own. An evader
that it lost goes on as it moved, ever more slowly, until `sightings.MEMORY_TIME`, or until the
robot sees that it is not there. A message holds where its sender is, and where it saw an evader
last; if that place is new, the sender has just seen it, and how far it moved is its velocity. A
teammate that it neither sees nor hears is where it was. `heard`: [N, N, 5] of `heard_goals`.
"""

from typing import NamedTuple

import numpy as np

from swarmdata.behavior_policies.heard_goals import HEARD_X, HEARD_Y, MASK, TARGET_X, TARGET_Y
from swarmdata.envs.pursuit.sightings import CAPTURED, FREE, MEMORY_TIME, Columns, sighting
from swarmdata.numerics.sight import sees
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.types import Bool, Double, Float

LOST_AGE = 99.0  # age, s, of a belief that says nothing
VELOCITY_KEPT = 0.9  # share of its velocity that a lost evader keeps in a control step

MISSED_AGE, MISSED_SHARE = 0.3, 0.7
"""A robot sees that an evader is not where it believes it, if it has not seen it for this time (s)
and that place is within this share of its sight range."""

SAME_PLACE_DISTANCE = 1e-3  # m below which two places that robots tell of are the same


class Hunt(NamedTuple):
    """Constants of the task and of the team."""

    columns: Columns  # of the states
    half: Double  # [2] m, half width and half height of the arena
    radius: float  # m, of the largest robot
    speed: float  # m/s, of the fastest robot
    evader_speed: float  # m/s
    dt: float  # s, of a control step
    sight_range: float  # m; not read where robots see everything
    captors: int
    directions: Double  # [D, 2] around an evader


class Beliefs(NamedTuple):
    """Beliefs of V views in one episode; a team that sees everything has one view, others N."""

    places: Double  # [V, K, 2] m, of evaders
    velocities: Double  # [V, K, 2] m/s, of evaders
    ages: Double  # [V, K] s since they were seen
    are_gone: Bool  # [V, K] evaders that are known to be captured
    mates: Double  # [V, N, 2] m, where the robots are
    told: Double  # [N, N, 2] m, target of each sender in its last message to each robot


@kernel
def is_known(beliefs: Beliefs, v: int, k: int) -> bool:
    """Whether view v knows a place of evader k, which is free."""
    return bool(beliefs.ages[v, k] < MEMORY_TIME and not beliefs.are_gone[v, k])


@kernel
def place_of(state: Float, i: int) -> tuple[float, float]:
    """Where robot i is, m."""
    return np.float64(state[N_COLUMNS * i]), np.float64(state[N_COLUMNS * i + 1])


@kernel
def believe_sight(i: int, v: int, state: Float, hunt: Hunt, beliefs: Beliefs) -> None:
    """Takes over what robot i sees of the evaders, and lets the others move on."""
    for k in range(hunt.columns.n_evaders):
        known = sighting(state, i, k, hunt.columns)
        place, velocity = beliefs.places[v, k], beliefs.velocities[v, k]
        if known.status == CAPTURED:
            beliefs.are_gone[v, k] = True
        if known.status == FREE and known.age == 0.0:
            place[0], place[1], velocity[0], velocity[1] = known.x, known.y, known.vx, known.vy
            beliefs.ages[v, k] = 0.0
            continue
        beliefs.ages[v, k] += hunt.dt
        for axis in range(2):
            room = hunt.half[axis] - hunt.radius
            velocity[axis] *= VELOCITY_KEPT
            place[axis] = min(max(place[axis] + velocity[axis] * hunt.dt, -room), room)


@kernel
def told_evader(v: int, x: float, y: float, beliefs: Beliefs) -> int:
    """The evader that view v takes for the one at (x, y): the nearest known, a lost one, or -1."""
    best, least = -1, 1.0
    for k in range(beliefs.ages.shape[1]):
        dx, dy = beliefs.places[v, k, 0] - x, beliefs.places[v, k, 1] - y
        if is_known(beliefs, v, k) and dx * dx + dy * dy < least:
            best, least = k, dx * dx + dy * dy
    if best >= 0:
        return best
    for k in range(beliefs.ages.shape[1]):
        if not is_known(beliefs, v, k) and not beliefs.are_gone[v, k]:
            return k
    return -1


@kernel
def believe_messages(i: int, heard: Double, hunt: Hunt, beliefs: Beliefs) -> None:
    """Takes over what robot i, whose view is i, is told of evaders and of the senders' places."""
    for j in range(heard.shape[1]):
        if j == i or heard[i, j, MASK] == 0.0:
            continue
        beliefs.mates[i, j, 0], beliefs.mates[i, j, 1] = heard[i, j, HEARD_X], heard[i, j, HEARD_Y]
        x, y, last = heard[i, j, TARGET_X], heard[i, j, TARGET_Y], beliefs.told[i, j]
        to_x, to_y = x - heard[i, j, HEARD_X], y - heard[i, j, HEARD_Y]
        dx, dy = x - last[0], y - last[1]
        moved, same = dx * dx + dy * dy, SAME_PLACE_DISTANCE * SAME_PLACE_DISTANCE
        last[0], last[1] = x, y
        if to_x * to_x + to_y * to_y < same or moved < same:
            continue
        k = told_evader(i, x, y, beliefs)
        if k < 0 or beliefs.ages[i, k] == 0.0:
            continue
        reach = 1.5 * hunt.evader_speed * hunt.dt
        share = 1.0 / hunt.dt if moved < reach * reach else 0.0
        beliefs.velocities[i, k, 0], beliefs.velocities[i, k, 1] = share * dx, share * dy
        beliefs.places[i, k, 0], beliefs.places[i, k, 1] = x, y
        beliefs.ages[i, k] = hunt.dt


@kernel
def doubt(i: int, heard: Double, layout: Float, hunt: Hunt, beliefs: Beliefs) -> None:
    """Forgets evaders that are not where robot i believes them, as it sees or a sender would."""
    for k in range(beliefs.ages.shape[1]):
        for j in range(heard.shape[1]):
            if heard[i, j, MASK] > 0.0 and beliefs.ages[i, k] > MISSED_AGE:
                x, y = heard[i, j, HEARD_X], heard[i, j, HEARD_Y]
                px, py = beliefs.places[i, k, 0], beliefs.places[i, k, 1]
                if sees(x, y, px, py, MISSED_SHARE * hunt.sight_range, layout):
                    beliefs.ages[i, k] = LOST_AGE


@kernel
def update_beliefs(
    state: Float, heard: Double, layout: Float, hunt: Hunt, beliefs: Beliefs
) -> None:
    """Updates the beliefs of one episode in a control step, by `state` [S] and `layout` [M, 8]."""
    n, is_limited = heard.shape[0], hunt.columns.memory >= 0
    for v in range(beliefs.ages.shape[0]):
        believe_sight(v, v, state, hunt, beliefs)
        x, y = place_of(state, v)
        for j in range(n):
            px, py = place_of(state, j)
            if not is_limited or sees(x, y, px, py, hunt.sight_range, layout):
                beliefs.mates[v, j, 0], beliefs.mates[v, j, 1] = px, py
        if is_limited:
            believe_messages(v, heard, hunt, beliefs)
            doubt(v, heard, layout, hunt, beliefs)


def blank_beliefs(n_copies: int, n_views: int, n_agents: int, n_evaders: int) -> Beliefs:
    """Beliefs of E copies that say nothing; each field has a leading axis E."""
    return Beliefs(
        places=np.zeros((n_copies, n_views, n_evaders, 2)),
        velocities=np.zeros((n_copies, n_views, n_evaders, 2)),
        ages=np.full((n_copies, n_views, n_evaders), LOST_AGE),
        are_gone=np.zeros((n_copies, n_views, n_evaders), dtype=np.bool_),
        mates=np.zeros((n_copies, n_views, n_agents, 2)),
        told=np.full((n_copies, n_agents, n_agents, 2), LOST_AGE),
    )
