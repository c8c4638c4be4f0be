"""The controller a robotics engineer would write: waypoints from a map, then reciprocal avoidance.

Each robot, alone, in each step:

1. aims at the farthest visible point of its way to the goal (`planner`), and brakes near the goal;
2. turns its aim to the right while a robot that is close ahead comes nearer, which breaks the
   symmetry that stalls reciprocal avoidance head-on;
3. takes the velocity nearest to its aim that is safe (`orca`): against surfaces it may approach
   only so fast that it can still brake, against robots it takes its share of avoiding.
"""

import math

import numpy as np
from numba import njit

from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.behavior_policies.orca import damper_half_plane, robot_half_plane, solve
from swarmdata.behavior_policies.planner import (
    MARGIN,
    Int32,
    fill_clearances,
    fill_ways,
    fill_weights,
    grid_shape,
    n_primitives,
    primitives_of,
    waypoint,
    nearest_node,
)
from swarmdata.behavior_policies.simple import APPROACH_RATE, STATE_COLUMNS
from swarmdata.errors import SchemaError, SpecError
from swarmdata.geometry import nearest, wall_gap
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds, Step

HORIZON = 1.0
RECOVERY = 0.4
KEEP = 0.03
BRAKE = 0.4
KEEP_WALL = 0.01
COS, SIN = 0.955336489125606, 0.29552020666133955


@njit(nogil=True, cache=True)
def surface_half_planes(x, y, radius, primitives, half, planes):
    n = 0
    reach = radius + 0.3
    for m in range(primitives.shape[0]):
        dx, dy = float(primitives[m, 1]) - x, float(primitives[m, 2]) - y
        size = reach + primitives[m, 5] + primitives[m, 6]
        if dx * dx + dy * dy > size * size:
            continue
        d, vx, vy = nearest(x, y, primitives[m])
        if 0.0 < d < reach:
            damper_half_plane(vx / d, vy / d, (d - radius - KEEP_WALL) / BRAKE, planes[n])
            n += 1
    for wall in range(4):
        gap = wall_gap(x, y, half, wall)
        if gap < reach:
            sign = 1.0 if wall % 2 == 0 else -1.0
            damper_half_plane(sign * (wall < 2), sign * (wall >= 2), (gap - radius - KEEP_WALL) / BRAKE, planes[n])
            n += 1
    return n


@njit(nogil=True, cache=True)
def act_copy(robots, limits, primitives, half, grid, costs, ways, goals, planes, out):
    N = robots.shape[0]
    for i in range(N):
        x, y, vx, vy = robots[i, 0], robots[i, 1], robots[i, 2], robots[i, 3]
        radius, vmax = limits[i, 0], limits[i, 1]
        tx, ty = waypoint(x, y, goals[i], radius + MARGIN, grid, (costs[i], ways[i]), half)
        dx, dy = tx - x, ty - y
        d = math.sqrt(dx * dx + dy * dy)
        at_end = tx == goals[i, 0] and ty == goals[i, 1]
        speed = min(vmax, APPROACH_RATE * d) if at_end else vmax
        s = speed / max(d, 1e-9)
        ax, ay = dx * s, dy * s
        n_hard = surface_half_planes(x, y, radius, primitives, half, planes)
        n = n_hard
        turn = False
        for j in range(N):
            if j == i:
                continue
            ox, oy = robots[j, 0] - x, robots[j, 1] - y
            dist2 = ox * ox + oy * oy
            if dist2 > 2.25:
                continue
            wx, wy = robots[j, 2], robots[j, 3]
            if dist2 < 1.0 and ox * ax + oy * ay > 0.0:
                turn = True
            robot_half_plane((ox, oy), (vx, vy), (wx, wy), radius + limits[j, 0] + KEEP, (HORIZON, RECOVERY, 0.5), planes[n])
            n += 1
        if turn:
            ax, ay = COS * ax + SIN * ay, COS * ay - SIN * ax
        rx, ry = solve(planes, n, n_hard, vmax, (ax, ay))
        out[i, 0], out[i, 1] = rx / vmax, ry / vmax


@njit(nogil=True, cache=True)
def act_copies(robots, limits, primitives, half, grids, costs, ways, goals, out):
    planes = np.empty((primitives.shape[1] + 4 + robots.shape[1], 4))
    for b in range(robots.shape[0]):
        act_copy(robots[b], limits, primitives[b], half, grids[b], costs[b], ways[b], goals[b], planes, out[b])


@njit(nogil=True, cache=True)
def plan_copy(layout, half, goals, limits, grid, weights, costs, ways):
    fill_clearances(layout, half, grid)
    columns = grid.shape[1]
    for i in range(goals.shape[0]):
        if i == 0 or limits[i, 0] != limits[i - 1, 0]:
            fill_weights(grid, limits[i, 0], weights)
        g = nearest_node(goals[i, 0], goals[i, 1], weights - 1, columns, half)
        fill_ways(g, columns, weights, costs[i], ways[i])


class Scripted:
    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        self._spec = spec
        self._noise = check_noise(noise)
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self._limits = np.array([[r.radius, r.max_speed] for r in spec.robots])
        self._seeds = np.zeros(0, dtype=np.uint64)

    def reset(self, step: Step, copies: Int) -> None:
        E, N = len(step.seeds), self._spec.n_agents
        shape = grid_shape(self._spec)
        n = shape[0] * shape[1]
        if len(self._seeds) != E:
            self._seeds = np.zeros(E, dtype=np.uint64)
            self._grids = np.zeros((E, *shape), dtype=np.float32)
            self._costs = np.zeros((E, N, n), dtype=np.int32)
            self._ways = np.zeros((E, N, n), dtype=np.int32)
            self._goals = np.zeros((E, N, 2))
            self._primitives = np.zeros((E, n_primitives(self._spec), 8), dtype=np.float32)
            self._weights = np.zeros(n, dtype=np.int32)
        for b in copies:
            self._goals[b] = step.states[b].reshape(N, 6)[:, 4:]
            self._primitives[b] = primitives_of(step.layouts[b])
            plan_copy(step.layouts[b], self._half, self._goals[b], self._limits, self._grids[b], self._weights, self._costs[b], self._ways[b])
            self._seeds[b] = step.seeds[b]

    def act(self, step: Step) -> Float:
        E = len(step.seeds)
        robots = step.states.astype(np.float64).reshape(E, -1, STATE_COLUMNS)
        out = np.zeros((E, robots.shape[1], 2))
        act_copies(robots, self._limits, self._primitives, self._half, self._grids, self._costs, self._ways, self._goals, out)
        return add_noise(out, step, self._noise).astype(np.float32)
