"""The controller a robotics engineer would write: waypoints from a map, then reciprocal avoidance.

Each robot, on its own, in each step:

1. aims at the farthest visible point of its way to the goal (`planner`), and brakes near the goal;
2. turns its aim to the right while another robot is close ahead, which breaks the symmetry that
   stalls reciprocal avoidance head-on;
3. takes the velocity nearest to its aim that is safe (`orca`). Surfaces are hard limits: it may
   approach them only so fast that it can still brake. Robots are soft limits, shared half and half.

Half and half fails at one place: a robot that rests at its goal in a passage sees no reason to
leave, and the other waits for ever. So there is a right of way: a robot within `avoidance.NEAR` of
its goal gives way to every robot that has farther to go. Besides its half, it makes room for the
velocity that the other *wants*, all by itself, so that a robot that was brought to a halt gets its
way too.

The times and distances here and in `avoidance` suit the default robot (0.6 m/s, 1.5 m/s^2).

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np
from numba import njit

from swarmdata.behavior_policies.avoidance import robot_half_planes, surface_half_planes
from swarmdata.behavior_policies.distance_field import Int32, fill_clearances, grid_shape
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.behavior_policies.orca import solve
from swarmdata.behavior_policies.planner import UNPLANNED, n_primitives, primitives_of, waypoint
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.errors import SchemaError, SpecError
from swarmdata.registry import make_task
from swarmdata.spec import TaskSpec
from swarmdata.states import TX, TY, VX, VY, X, Y, robots_of
from swarmdata.types import Double, Float, Int, Step

CLOSE = 1.0
"""Metres between centres below which a robot turns right for another."""

COS, SIN = 0.955336489125606, 0.29552020666133955
"""Of the turn to the right, 0.3 rad."""


@njit(nogil=True, cache=True)
def turned_right(i: int, robots: Double, aim: tuple[float, float]) -> tuple[float, float]:
    """Returns the aim of robot i, turned 0.3 rad to the right if a robot is close ahead.

    Args:
        i: which robot.
        robots: columns of the state, [N, 6].
        aim: preferred velocity, m/s.
    """
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        if j != i and x * x + y * y < CLOSE * CLOSE and x * aim[0] + y * aim[1] > 0.0:
            return COS * aim[0] + SIN * aim[1], COS * aim[1] - SIN * aim[0]
    return aim


@njit(nogil=True, cache=True)
def preferred(
    robot: Double,
    limits: Double,
    grid: Float,
    ways: tuple[Int32, Int32],
    half: Double,
    out: Double,
) -> None:
    """Writes the velocity a robot would take alone, m/s, and its distance to the goal, m.

    Args:
        robot: its columns of the state, [6].
        limits: radius, m, and maximum speed, m/s, [2].
        grid: clearances, m, [rows, columns].
        ways: costs and next nodes, each [n].
        half: half width and half height of the arena, m, [2].
        out: written, [3].
    """
    x, y, goal = robot[0], robot[1], robot[4:6]
    to_x, to_y = waypoint((x, y), goal, limits[0], grid, ways, half)
    dx, dy = to_x - x, to_y - y
    d = math.sqrt(dx * dx + dy * dy)
    gx, gy = goal[0] - x, goal[1] - y
    out[2] = math.sqrt(gx * gx + gy * gy)
    speed = min(limits[1], APPROACH_RATE * out[2])
    out[0], out[1] = dx * (speed / max(d, 1e-9)), dy * (speed / max(d, 1e-9))


@njit(nogil=True, cache=True)
def act_copies(
    robots: Double,
    limits: Double,
    half: Double,
    maps: tuple[Float, Float, Int32, Int32],
    out: Double,
) -> None:
    """Writes the commands of all robots of all copies.

    Args:
        robots: columns of the state, [E, N, 6].
        limits: radius, m, and maximum speed, m/s, [N, 2].
        half: half width and half height of the arena, m, [2].
        maps: convex obstacles [E, P, 8]; clearances [E, rows, columns]; costs and next nodes of
            the ways, each [E, N, n].
        out: written, velocity / maximum speed, [E, N, 2].
    """
    primitives, grids, costs, ways = maps
    n_robots = robots.shape[1]
    planes = np.empty((primitives.shape[1] + 4 + 2 * n_robots, 4))
    aims = np.empty((n_robots, 3))
    for b in range(robots.shape[0]):
        now = robots[b]
        for i in range(n_robots):
            way = (costs[b, i], ways[b, i])
            preferred(now[i], limits[i], grids[b], way, half, aims[i])
        for i in range(n_robots):
            n_hard = surface_half_planes(
                now[i, 0], now[i, 1], limits[i, 0], primitives[b], half, planes
            )
            n = robot_half_planes(i, now, limits[:, 0], aims, n_hard, planes)
            aim = turned_right(i, now, (aims[i, 0], aims[i, 1]))
            vx, vy = solve(planes, n, n_hard, limits[i, 1], aim)
            out[b, i, 0], out[b, i, 1] = vx / limits[i, 1], vy / limits[i, 1]


class Scripted:
    """Waypoint planner and reciprocal collision avoidance, for holonomic robots.

    It knows more than the robots see: the map (`step.layouts`) and the positions, velocities and
    goals of all robots (`step.states`).

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each action component.

    Raises:
        SpecError: a robot is not holonomic or not driven by velocity commands, or `noise` is not
            a standard deviation.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        for name, robot in zip(spec.agent_names, spec.robots, strict=True):
            if (robot.dynamics, robot.command) != ("holonomic", "velocity"):
                raise SpecError(
                    f"{name} has {robot.dynamics} dynamics with {robot.command} commands; the "
                    "scripted policy drives holonomic robots by velocity commands."
                )
        self._noise = check_noise(noise)
        self._shape = grid_shape(spec)
        self._n_primitives = n_primitives(make_task(spec).kinds)
        self._action_size = spec.action_size
        self._half = np.array([spec.arena.width / 2.0, spec.arena.height / 2.0])
        self._limits = np.array([[robot.radius, robot.max_speed] for robot in spec.robots])
        self._cap = float(self._limits[:, 0].max()) + 0.15
        self._allocate(0)

    def _allocate(self, n_copies: int) -> None:
        """Makes room for the maps of `n_copies` episodes; none is valid yet."""
        nodes = (n_copies, len(self._limits), self._shape[0] * self._shape[1])
        self._planned = np.zeros(n_copies, dtype=np.bool_)
        self._seeds = np.zeros(n_copies, dtype=np.uint64)
        self._primitives = np.zeros((n_copies, self._n_primitives, 8), dtype=np.float32)
        self._grids = np.zeros((n_copies, *self._shape), dtype=np.float32)
        self._costs, self._ways = np.zeros(nodes, np.int32), np.zeros(nodes, np.int32)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`."""
        if len(step.seeds) != len(self._seeds):
            self._allocate(len(step.seeds))
        for b in copies:
            self._primitives[b] = primitives_of(step.layouts[b])
            fill_clearances(step.layouts[b], self._half, self._cap, self._grids[b])
        self._costs[copies, :, 0] = UNPLANNED
        self._seeds[copies], self._planned[copies] = step.seeds[copies], True

    def act(self, step: Step) -> Float:
        n_copies = len(step.seeds)
        if n_copies != len(self._seeds) or not (
            self._planned.all() and np.array_equal(self._seeds, step.seeds)
        ):
            raise SchemaError(
                "the scripted policy has no map of some episodes of this step. Call "
                "policy.reset(step, copies) whenever the environment resets copies."
            )
        robots = robots_of(step.states, len(self._limits)).astype(np.float64)
        robots = np.ascontiguousarray(robots[..., [X, Y, VX, VY, TX, TY]])
        maps = (self._primitives, self._grids, self._costs, self._ways)
        commands = np.empty((n_copies, len(self._limits), 2))
        act_copies(robots, self._limits, self._half, maps, commands)
        actions = np.zeros((n_copies, len(self._limits), self._action_size), dtype=np.float32)
        actions[..., :2] = add_noise(commands, step, self._noise)
        return actions
