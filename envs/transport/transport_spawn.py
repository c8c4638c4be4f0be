"""Episodes of `transport`: obstacles, a payload with room around it, its goal, and the robots.

A pure function of the episode seed, with the random numbers of `seeding`; obstacles and points are
placed as in `spawn`, so every passage is as wide as `obstacles.gap`.
"""

import numpy as np

from swarmdata.envs.world.spawn import place_obstacles, place_points
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.random import STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.types import Bool, Double, Float, Int, Seeds

_LAYOUT_STREAM = STREAMS["layout"]


@kernel
def _draw_direction(bits: np.uint64, out: Float) -> None:
    """Writes a rational point of the unit circle, [2]."""
    t = 2.0 * to_uniform(absorb(bits, 0)) - 1.0
    sign = 1.0 if to_uniform(absorb(bits, 1)) < 0.5 else -1.0
    out[0] = sign * (1.0 - t * t) / (1.0 + t * t)
    out[1] = sign * 2.0 * t / (1.0 + t * t)


@kernel
def _place(
    state: Seeds,
    sizes: Double,
    half: Double,
    radii: Double,
    room: Double,
    layout: Float,
    robots: Float,
    body: Float,
) -> bool:
    """Draws obstacles, the payload and its goal, then the robots; False if one found no place.

    Args:
        state: of the generator, [1].
        sizes: obstacles to draw, from `spawn.size_table`, [M, 4].
        half: half width and half height of the arena, m, [2].
        radii: m, [N].
        room: payload's bounding radius; gap between obstacles; free around the payload's start and
            goal; smallest distance between these; clearance and separation of robots; all m, [7].
        layout: written, [M, 8].
        robots: written, columns `states.ROBOT`, [N, 8].
        body: written, [7].
    """
    if not place_obstacles(state, sizes, half, room[1], layout):
        return False
    radius, start, goal = room[0:1], np.zeros((1, 2), np.float32), np.zeros((1, 2), np.float32)
    margins = np.array([room[2], 0.0])
    if not place_points(state, layout, half, radius, margins, start, start, 0.0):
        return False
    margins[0] = room[3]
    if not place_points(state, layout, half, radius, margins, goal, start, room[4]):
        return False
    body[0:2] = start[0]
    for i in range(radii.shape[0]):
        robots[i, TX], robots[i, TY] = goal[0, 0], goal[0, 1]
    around = np.zeros((layout.shape[0] + 1, 8), np.float32)  # the payload is in the robots' way
    around[:-1] = layout
    around[-1, 0], around[-1, 1], around[-1, 2] = CIRCLE, body[0], body[1]
    around[-1, 5] = around[-1, 6] = radius[0]
    starts = robots[:, X : Y + 1]
    return place_points(state, around, half, radii, room[5:7], starts, starts, 0.0)


@kernel
def draw_episodes(
    seeds: Seeds,
    copies: Int,
    sizes: Double,
    half: Double,
    team: tuple[Double, Bool],
    room: Double,
    max_attempts: int,
    layouts: Float,
    states: Float,
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed.

    Args:
        seeds: episode seeds, [len(copies)].
        copies: rows to write.
        sizes: obstacles to draw, [M, 4].
        half: half width and half height of the arena, m, [2].
        team: radii, m, and whether a heading is drawn, each [N].
        room: see `_place`, [7].
        max_attempts: whole layouts to try before giving up.
        layouts: written, [E, M, 8].
        states: written, [E, S].
    """
    radii, turns = team
    n = radii.shape[0]
    first = N_COLUMNS * n
    generator = np.empty(1, np.uint64)
    for k in range(copies.shape[0]):
        state, layout = states[copies[k]], layouts[copies[k]]
        robots, body = state[:first].reshape(n, N_COLUMNS), state[first : first + len(BODY)]
        key = absorb(seeds[k], _LAYOUT_STREAM)
        generator[0] = key
        for attempt in range(max_attempts + 1):
            if attempt == max_attempts:
                return k
            if _place(generator, sizes, half, radii, room, layout, robots, body):
                break
        for i in range(n):
            robots[i, VX] = robots[i, VY] = robots[i, UY] = 0.0
            robots[i, UX] = 1.0
            if turns[i]:
                _draw_direction(absorb(key, 2 + i), robots[i, UX : UY + 1])
        body[2] = body[3] = body[6] = 0.0
        _draw_direction(absorb(key, 0), body[4:6])
        if state.shape[0] > first + len(BODY):
            _draw_direction(absorb(key, 1), state[first + len(BODY) :])
    return copies.shape[0]
