"""Episodes of `formation`: a path, obstacles beside it that block some slots, then robots.

In every episode, checked every `PATH_CHECK_STEPS` control steps:

- all slots are inside the walls, and none moves faster than `MAX_SLOT_SPEED_SHARE` of the slowest
  robot's speed;
- the reference's path keeps `path_clearance` from every obstacle;
- in a share of the horizon (or of one segment of the path, if that is longer) within `blocked`, at
  least one slot is blocked: a robot in it would touch an obstacle;
- bounding circles of obstacles keep their gap from each other and from the walls, as in `spawn`;
- robots start at rest, apart, in free space, at most `start_spread` outside the square around the
  slots.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.envs.formation.formation_rules import PATH_CHECK_STEPS, FormationRules
from swarmdata.envs.formation.reference_path import PathPlan, draw_path, write_pose
from swarmdata.envs.formation.shapes import reach_of
from swarmdata.envs.world.spawn import (
    LAYOUT_OFFSET,
    PLACE_TRIES,
    SpawnPlan,
    is_apart,
    is_free_place,
    next_uniform,
    place_obstacles,
    put_at_rest,
)
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import bounding_radius, clearance, nearest
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds

MAX_SLOT_SPEED_SHARE = 0.8  # of the slowest robot's speed, at most; the rest is for catching up


class EpisodePlan(NamedTuple):
    """Everything in a spec that the episodes depend on."""

    path: PathPlan
    spawn: SpawnPlan
    offsets: Double  # slots in the reference's frame, m, [N, 2]
    checks: Double  # places of the path that are checked, in segments from the start, [L]
    blocked: tuple[float, float]  # smallest and largest share of blocked places
    path_clearance: float  # m
    start_reach: float  # half width of the square in which robots start, m


def plan_episodes(spec: TaskSpec, rules: FormationRules, offsets: Double) -> EpisodePlan:
    """Returns the plan of a spec whose formation has these slots, m, [N, 2].

    Raises:
        SpecError: the reference cannot move as the spec asks.
    """
    spawn = SpawnPlan.of(spec)
    radii = spawn.radii
    reach, rate = reach_of(offsets), 1.0 / rules.segment_time
    top = MAX_SLOT_SPEED_SHARE * min(robot.max_speed for robot in spec.robots)
    room = spawn.half - reach - radii.max() - spec.spawn.start_clearance
    _check_rules(rules, top, reach + float(radii.max()))
    if room.min() <= 0.0:
        raise SpecError(
            f"a {rules.shape} of {len(radii)} robots reaches {reach:.2f} m from its centre and "
            f"does not fit in the arena of {spec.arena.width:g} x {spec.arena.height:g} m. Enlarge "
            "arena or reduce rules.spacing."
        )
    duration = spec.horizon * spec.control_dt + max(rules.preview, default=0.0)
    n_points = math.ceil(duration * rate + 1e-9) + 3
    longest, tangent = rules.reference_speed / rate, math.tan(rules.max_turn / 2)
    tangent = round(tangent * 2.0**20) / 2.0**20  # has the same bits on every platform
    n_loop = min(n_points, math.ceil(2.0 * math.pi / max(rules.max_turn, 0.1)))
    n_steps = max(spec.horizon, math.ceil(rules.segment_time / spec.control_dt))
    steps = np.arange(0, n_steps + 1, PATH_CHECK_STEPS, dtype=np.float64)
    return EpisodePlan(
        path=PathPlan(room, n_points, longest, tangent, n_loop, rate, reach, top),
        spawn=spawn,
        offsets=offsets,
        checks=steps * spec.control_dt * rate,
        blocked=rules.blocked,
        path_clearance=rules.path_clearance,
        start_reach=reach + rules.start_spread,
    )


def _check_rules(rules: FormationRules, top: float, width: float) -> None:
    """Raises if slots are too fast, or cannot be blocked and free for the shares of time asked."""
    low, high = rules.blocked
    if rules.reference_speed > top:
        raise SpecError(
            f"rules.reference_speed is {rules.reference_speed:g} m/s, expected at most {top:g}: "
            f"{MAX_SLOT_SPEED_SHARE:g} of the slowest robot's max_speed, so that robots can catch "
            "up."
        )
    if low > high or rules.hold_fraction > 1.0 - high:
        raise SpecError(
            f"rules.blocked is ({low:g}, {high:g}) and rules.hold_fraction is "
            f"{rules.hold_fraction:g}, expected the smaller share first, and to hold no more than "
            "what is left of the time: while a slot is blocked, nobody can be in formation."
        )
    if low > 0.0 and width <= rules.path_clearance:
        raise SpecError(
            f"rules.blocked begins at {low:g}, expected 0: the robots reach {width:.2f} m from the "
            f"reference, and obstacles stay rules.path_clearance, {rules.path_clearance:g} m, away."
        )


@kernel
def _is_clear_of_path(row: Float, poses: Double, path_clearance: float) -> bool:
    reach = bounding_radius(row) + path_clearance
    x, y = float(row[1]), float(row[2])
    for k in range(poses.shape[0]):
        dx, dy = poses[k, 0] - x, poses[k, 1] - y
        is_near = dx * dx + dy * dy < reach * reach
        if is_near and nearest(poses[k, 0], poses[k, 1], row)[0] < path_clearance:
            return False
    return True


@kernel
def _place_beside(state: Seeds, plan: EpisodePlan, poses: Double, layout: Float) -> bool:
    """Draws all obstacles beside the path; returns False if one of them found no place."""
    gap = plan.spawn.obstacle_gap
    for m in range(plan.spawn.sizes.shape[0]):
        size, row = plan.spawn.sizes[m : m + 1], layout[m]
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            if not place_obstacles(state, size, plan.spawn.half, gap, layout[m : m + 1]):
                return False
            is_free = is_apart(row, layout, m, gap)
            if is_free and _is_clear_of_path(row, poses, plan.path_clearance):
                break
    return True


@kernel
def blocked_share(
    poses: Double, offsets: Double, radii: Double, layout: Float, half: Double
) -> float:
    """Share of poses [L, 4] in which some slot is blocked for a robot of the largest radius."""
    largest, n_blocked = radii.max(), 0
    for k in range(poses.shape[0]):
        x, y, ux, uy = poses[k, 0], poses[k, 1], poses[k, 2], poses[k, 3]
        for i in range(offsets.shape[0]):
            sx = x + ux * offsets[i, 0] - uy * offsets[i, 1]
            sy = y + uy * offsets[i, 0] + ux * offsets[i, 1]
            if clearance(sx, sy, layout, half) < largest:
                n_blocked += 1
                break
    return n_blocked / poses.shape[0]


@kernel
def _place_team(
    state: Seeds, plan: EpisodePlan, pose: Double, layout: Float, robots: Float
) -> bool:
    """Draws the robots' places around the first pose; returns False if one of them found none."""
    spawn, reach, points = plan.spawn, plan.start_reach, robots[:, X : Y + 1]
    half = spawn.half
    low_x, high_x = max(pose[0] - reach, -half[0]), min(pose[0] + reach, half[0])
    low_y, high_y = max(pose[1] - reach, -half[1]), min(pose[1] + reach, half[1])
    for i in range(spawn.radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            points[i, 0] = low_x + (high_x - low_x) * next_uniform(state)
            points[i, 1] = low_y + (high_y - low_y) * next_uniform(state)
            if is_free_place(points, i, spawn.radii, spawn.starts, layout, half):
                break
    return True


@kernel
def _draw_one(
    state: Seeds, plan: EpisodePlan, poses: Double, path: Float, layout: Float, robots: Float
) -> bool:
    """Draws one episode; returns False if its path, an obstacle or a robot found no place."""
    if not draw_path(state, plan.path, path):
        return False
    for check in range(poses.shape[0]):
        write_pose(path, 0, plan.checks[check], poses[check], 0)
    if not _place_beside(state, plan, poses, layout):
        return False
    share = blocked_share(poses, plan.offsets, plan.spawn.radii, layout, plan.spawn.half)
    if share < plan.blocked[0] or share > plan.blocked[1]:
        return False
    return bool(_place_team(state, plan, poses[0], layout, robots))


@kernel
def _draw(
    seeds: Seeds, copies: Int, plan: EpisodePlan, points: int, layouts: Float, states: Float
) -> int:
    """Draws the episodes `seeds`; returns how many were drawn before one failed."""
    state, n = np.empty(1, np.uint64), plan.spawn.radii.shape[0]
    poses = np.empty((plan.checks.shape[0], 4))
    for k in range(copies.shape[0]):
        b, attempts_left = copies[k], plan.spawn.max_attempts
        path, robots = states[b, points:], states[b, : N_COLUMNS * n].reshape(n, N_COLUMNS)
        state[0] = seeds[k] + np.uint64(LAYOUT_OFFSET)
        while attempts_left > 0 and not _draw_one(state, plan, poses, path, layouts[b], robots):
            attempts_left -= 1
        if attempts_left == 0:
            return k
        for i in range(n):
            put_at_rest(state, plan.spawn.has_heading[i], robots[i])
    return copies.shape[0]


def draw_episodes(
    plan: EpisodePlan, seeds: Seeds, copies: Int, layouts: Float, states: Float
) -> None:
    """Draws obstacles, robots and, at the end of a row, control points of the episodes `seeds` [C].

    They are written to the rows `copies` of `layouts` [E, M, 8] and `states` [E, S].

    Raises:
        SpawnError: no episode was found in `spawn.max_attempts` attempts, though one may exist.
    """
    drawn = _draw(seeds, copies, plan, states.shape[1] - 2 * plan.path.n_points, layouts, states)
    if drawn < len(copies):
        low, high = plan.blocked
        raise SpawnError(
            f"no episode found for seed {seeds[drawn]} in {plan.spawn.max_attempts} attempts: a "
            f"path with obstacles {plan.path_clearance:g} m beside it that block a slot {low:.0%} "
            f"to {high:.0%} of the time. Widen rules.blocked, enlarge the arena, use fewer "
            "obstacles, or let the path turn more (rules.max_turn) or more slowly "
            "(rules.reference_speed)."
        )
