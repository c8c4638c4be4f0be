"""Episodes of `pursuit`: obstacles, robots in one corner of the arena, and evaders away from them.

Evaders keep the distances of goals, `min_goal_distance` from every robot among them.
"""

import numpy as np

from swarmdata.envs.pursuit.sightings import Columns, aim, remember
from swarmdata.envs.world.spawn import (
    LAYOUT_OFFSET,
    PLACE_TRIES,
    SpawnPlan,
    direction_of,
    is_free_place,
    next_uniform,
    place_obstacles,
    put_at_rest,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, X, Y
from swarmdata.types import Double, Float, Int, Seeds


@kernel
def place_robots(
    state: Seeds, plan: SpawnPlan, corner: int, size: float, layout: Float, starts: Float
) -> bool:
    """Draws the robots' starts in a square in a corner; returns False if one found no place.

    The two bits of `corner` say whether it is at the right, and whether at the top. `size`: m.
    """
    for i in range(plan.radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            for axis in range(2):
                inside = plan.half[axis] - size * next_uniform(state)
                starts[i, axis] = inside if (corner >> axis) & 1 else -inside
            if is_free_place(starts, i, plan.radii, plan.starts, layout, plan.half):
                break
    return True


@kernel
def place_evaders(
    state: Seeds, plan: SpawnPlan, radii: Double, layout: Float, starts: Float, evaders: Float
) -> bool:
    """Draws the evaders' places, of these radii, away from all starts; False if one found none."""
    most = plan.min_goal_distance * plan.min_goal_distance
    for k in range(radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            for axis in range(2):
                room = plan.half[axis] - radii[k]
                evaders[k, axis] = room * (2.0 * next_uniform(state) - 1.0)
            is_far = True
            for i in range(starts.shape[0]):
                dx = np.float64(starts[i, 0]) - np.float64(evaders[k, 0])
                dy = np.float64(starts[i, 1]) - np.float64(evaders[k, 1])
                is_far = bool(is_far and dx * dx + dy * dy >= most)
            if is_far and is_free_place(evaders, k, radii, plan.goals, layout, plan.half):
                break
    return True


@kernel
def start_pursuits(
    seeds: Seeds,
    copies: Int,
    plan: SpawnPlan,
    start_size: float,
    radii: Double,
    sight_range: float,
    columns: Columns,
    layouts: Float,
    states: Float,
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    n, state = plan.radii.shape[0], np.empty(1, np.uint64)
    for c in range(copies.shape[0]):
        row, layout = states[copies[c]], layouts[copies[c]]
        row[:] = 0.0
        robots = row[: N_COLUMNS * n].reshape(n, N_COLUMNS)
        starts = robots[:, X : Y + 1]
        evaders = row[columns.places : columns.captured].reshape(columns.n_evaders, 2)
        state[0] = seeds[c] + np.uint64(LAYOUT_OFFSET)
        corner = int(4.0 * next_uniform(state))
        for attempt in range(plan.max_attempts + 1):
            if attempt == plan.max_attempts:
                return c
            if (
                place_obstacles(state, plan.sizes, plan.half, plan.obstacle_gap, layout)
                and place_robots(state, plan, corner, start_size, layout, starts)
                and place_evaders(state, plan, radii, layout, starts, evaders)
            ):
                break
        for i in range(n):
            put_at_rest(state, plan.has_heading[i], robots[i])
        for k in range(columns.n_evaders):
            u = columns.headings + 2 * k
            row[u], row[u + 1] = direction_of(next_uniform(state), next_uniform(state))
        for i in range(n):
            remember(row, i, layout, sight_range, 0.0, columns)
            aim(row, i, columns)
    return copies.shape[0]
