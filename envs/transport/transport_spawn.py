"""Episodes of `transport`: obstacles, a payload with room around it, its goal, and the robots.

Obstacles and points are placed as in `spawn`: passages are at least as wide as `obstacles.gap`.
"""

import numpy as np

from swarmdata.envs.world.spawn import (
    Spacing,
    SpawnPlan,
    direction_of,
    place_obstacles,
    place_points,
    put_at_rest,
)
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.random import STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, UX, UY, X, Y
from swarmdata.types import Double, Float, Int, Seeds

_LAYOUT_STREAM = STREAMS["layout"]


@kernel
def _draw_direction(bits: np.uint64, out: Float) -> None:
    """Writes a random unit vector, [2]."""
    out[0], out[1] = direction_of(to_uniform(absorb(bits, 0)), to_uniform(absorb(bits, 1)))


@kernel
def _place(
    state: Seeds,
    plan: SpawnPlan,
    radius: Double,
    room: float,
    layout: Float,
    robots: Float,
    body: Float,
) -> bool:
    """Draws obstacles, the payload and its goal, then the robots; False if one found no place.

    `radius`: [1] of the payload's bounding circle, m. `room`: free around the payload's start, m.
    """
    if not place_obstacles(state, plan.sizes, plan.half, plan.obstacle_gap, layout):
        return False
    start, goal = np.zeros((1, 2), np.float32), np.zeros((1, 2), np.float32)
    at_start, at_goal = Spacing(room, 0.0), Spacing(plan.goals.clearance, 0.0)
    if not place_points(state, layout, plan.half, radius, at_start, start, start, 0.0):
        return False
    away = plan.min_goal_distance
    if not place_points(state, layout, plan.half, radius, at_goal, goal, start, away):
        return False
    body[0], body[1] = start[0, 0], start[0, 1]
    for i in range(plan.radii.shape[0]):
        robots[i, TX], robots[i, TY] = goal[0, 0], goal[0, 1]
    around = np.zeros((layout.shape[0] + 1, 8), np.float32)  # robots must not overlap the payload
    for m in range(layout.shape[0]):
        for c in range(8):
            around[m, c] = layout[m, c]
    around[-1, 0], around[-1, 1], around[-1, 2] = CIRCLE, body[0], body[1]
    around[-1, 5] = around[-1, 6] = radius[0]
    starts = robots[:, X : Y + 1]
    return place_points(state, around, plan.half, plan.radii, plan.starts, starts, starts, 0.0)


@kernel
def draw_episodes(
    seeds: Seeds,
    copies: Int,
    plan: SpawnPlan,
    payload_radius: float,
    room: float,
    layouts: Float,
    states: Float,
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    n = plan.radii.shape[0]
    first = N_COLUMNS * n
    generator, radius = np.empty(1, np.uint64), np.full(1, payload_radius)
    for k in range(copies.shape[0]):
        state, layout = states[copies[k]], layouts[copies[k]]
        robots, body = state[:first].reshape(n, N_COLUMNS), state[first : first + len(BODY)]
        key = absorb(seeds[k], _LAYOUT_STREAM)
        generator[0] = key
        for attempt in range(plan.max_attempts + 1):
            if attempt == plan.max_attempts:
                return k
            if _place(generator, plan, radius, room, layout, robots, body):
                break
        for i in range(n):
            put_at_rest(generator, False, robots[i])
            if plan.has_heading[i]:
                _draw_direction(absorb(key, 2 + i), robots[i, UX : UY + 1])
        body[2] = body[3] = body[6] = 0.0
        _draw_direction(absorb(key, 0), body[4:6])
        if state.shape[0] > first + len(BODY):
            _draw_direction(absorb(key, 1), state[first + len(BODY) :])
    return copies.shape[0]
