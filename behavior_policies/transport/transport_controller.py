"""The pushing controller a robotics engineer would write, for `transport`.

In each step, with the map and the positions of all:

1. the payload's way to its goal is planned as if it were its bounding circle (`planner`);
2. the one or two faces that point against that way get places for robots (`push_slots`), as many
   as have room, and every robot without one keeps clear of the way;
3. robots go to their places, around the payload and not through it (`way_around`), and wait there;
4. when those in place can move the payload along its way without turning it, they push: force by
   force, since a command of a velocity just above its own accelerates a robot (`pushing`).

On their way robots avoid surfaces and each other as in `scripted`; robots without a place give way.
In their places they only avoid surfaces: what they command there, the payload does not let happen.
What is remembered from step to step are the faces, the places, and whether they push, so that small
changes do not send robots around the payload.

It brings the payload to a position; it does not turn it to a wanted direction.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import robot_half_planes, surface_half_planes
from swarmdata.behavior_policies.navigation.distance_field import (
    Int32,
    check_maps,
    fill_clearances,
    grid_shape,
)
from swarmdata.behavior_policies.navigation.navigator import turned_right
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.planner import (
    UNPLANNED,
    n_primitives,
    primitives_of,
    waypoint,
)
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.behavior_policies.transport.payload_detour import N_POINTS, fill_rings
from swarmdata.behavior_policies.transport.push_moves import (
    away_from_surfaces,
    follow_place,
    go_to_place,
    keep_clear,
    payload_half_plane,
)
from swarmdata.behavior_policies.transport.push_slots import MAX_SLOTS, NONE, choose_slots
from swarmdata.behavior_policies.transport.push_team import (
    assign_slots,
    contact,
    possible_way,
    push_forces,
    stands,
)
from swarmdata.envs.transport.payload import Shape, payload_radius, place_row, shape_of
from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.registry.components import make_task
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload, TransportRules
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

SIDE_ROOM = 0.15
"""Metres beside the payload that its way keeps free where it can, for robots at its sides."""

STALE = 0.25
"""Metres that the payload moves before the robots' ways to it are planned anew."""


@kernel
def _plan(
    now: Double,
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    limits: Double,
    payload: Double,
    ground: tuple[Float, Double],
    memory: Int,
    slots: Double,
) -> int:
    """Chooses faces and places, and remembers them; returns how many places there are.

    `memory` is first face, second face, number of places, whether they push, then the place of
    each robot, [4 + N].
    """
    radius = limits[:, 0].max()
    team = (now.shape[0], radius, payload[4])
    before = (memory[0], memory[1])
    first, second, k = choose_slots(body, shape, way, before, team, ground, slots)
    if first != memory[0] or second != memory[1] or k != memory[2]:
        memory[0], memory[1], memory[2], memory[3] = first, second, k, 0
        memory[4:] = NONE
    if memory[3] != 1:
        assign_slots(now, body, shape, slots[:k], radius, memory[4:])
    return k


@kernel
def _stand(
    now: Double,
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    limits: Double,
    payload: Double,
    memory: Int,
    slots: Double,
    forces: Double,
) -> None:
    """Finds who is in place and whether they push; writes their forces, NaN for the others, [N]."""
    n, is_circle = now.shape[0], shape[0] == CIRCLE
    pushes, who = np.empty((n, 4)), np.empty(n, np.int64)
    found = 0
    forces[:] = np.nan
    for i in range(n):
        place = memory[4 + i]
        if place < 0:
            continue
        nx, ny, left, off = contact(now[i], limits[i, 3], body, shape, slots[place])
        if stands(left, off, is_circle, memory[3] == 1):
            who[found] = i
            pushes[found, 0], pushes[found, 1] = now[i, 0], now[i, 1]
            pushes[found, 2], pushes[found, 3] = nx, ny
            found += 1
    possible = possible_way(way, slots)
    out = np.empty(n)
    memory[3] = push_forces(body, possible, pushes[:found], payload, out)
    for f in range(found):
        forces[who[f]] = out[f] if memory[3] == 1 else 0.0


@kernel
def _aim(
    now: Double,
    body: Double,
    shape: Shape,
    way: tuple[float, float],
    limits: Double,
    payload: Double,
    dt: float,
    ground: tuple[Float, Double],
    ways: tuple[Int32, Int32],
    memory: Int,
    aims: Double,
) -> None:
    """Writes what every robot would do alone, [N, 4].

    That is its velocity, m/s; a distance to its goal, for the right of way; and 1 in its place.
    """
    n = now.shape[0]
    slots, forces = np.empty((MAX_SLOTS, 4)), np.empty(n)
    k = _plan(now, body, shape, way, limits, payload, ground, memory, slots)
    _stand(now, body, shape, way, limits, payload, memory, slots[:k], forces)
    standing = ~np.isnan(forces)
    rings = (np.empty((N_POINTS, 2)), np.empty(N_POINTS, np.bool_))
    fill_rings(body, shape, limits[:, 0].max(), ground, rings[0], rings[1])
    for i in range(n):
        place = memory[4 + i]
        aims[i, 3] = 1.0 if standing[i] else 0.0
        if place < 0:
            reach = math.sqrt(shape[1] * shape[1] + shape[2] * shape[2])
            keep_clear(now[i], limits[i], body, way, reach, aims[i])
        elif standing[i]:
            push = contact(now[i], limits[i, 3], body, shape, slots[place])
            follow_place(now[i], body, push, forces[i], dt, aims[i])
        else:
            team, slot = (now, standing), slots[place]
            go_to_place(i, limits, body, shape, slot, team, rings, ground, ways, aims[i])


@kernel
def act_copies(
    robots: Double,
    bodies: Double,
    shape: Shape,
    limits: Double,
    payload: Double,
    dt: float,
    half: Double,
    maps: tuple[Float, Float],
    ways: tuple[Int32, Int32, Int32, Int32],
    planned: Double,
    memory: Int,
    out: Double,
) -> None:
    """Writes the velocity of every robot of all copies.

    Args:
        robots: columns x, y, vx, vy, goal x, goal y, [E, N, 6].
        bodies: columns `states.BODY`, [E, 7].
        shape: of the payload.
        limits: radius, maximum speed, acceleration, and how much smaller the radius is than the
            largest, SI, [N, 4].
        payload: see `push_forces`; then how many times a robot's force it takes to move it, and the
            radius of its way, m; [6].
        dt: control step, s.
        half: half width and half height of the arena, m, [2].
        maps: convex obstacles, [E, P, 8]; clearances, m, [E, rows, columns].
        ways: costs and next nodes of the payload's way to its goal and of the robots' to the
            payload, each [E, n].
        planned: where the payload was when the latter were planned, m, [E, 2].
        memory: see `_plan`, [E, 4 + N].
        out: written, m/s, [E, N, 2].
    """
    (primitives, grids), n_robots = maps, robots.shape[1]
    planes = np.empty((primitives.shape[1] + 5 + 2 * n_robots, 4))
    aims, row = np.empty((n_robots, 4)), np.empty(8, np.float32)
    for b in range(robots.shape[0]):
        now, body, ground = robots[b], bodies[b], (grids[b], half)
        if abs(body[0] - planned[b, 0]) + abs(body[1] - planned[b, 1]) > STALE:
            ways[2][b, 0] = UNPLANNED
            planned[b] = body[:2]
        x, y = waypoint(
            (body[0], body[1]), now[0, 4:6], payload[5], grids[b], (ways[0][b], ways[1][b]), half
        )
        way = away_from_surfaces(body, (x - body[0], y - body[1]), payload[5], ground)
        _aim(
            now, body, shape, way, limits, payload, dt, ground,
            (ways[2][b], ways[3][b]), memory[b], aims,
        )  # fmt: skip
        place_row(body, shape, row)
        for i in range(n_robots):
            radius = limits[i, 0]
            n_hard = surface_half_planes(now[i, 0], now[i, 1], radius, primitives[b], half, planes)
            n, aim = n_hard, (aims[i, 0], aims[i, 1])
            if aims[i, 3] == 0.0:
                n_hard = payload_half_plane(now[i], radius, body, row, planes, n_hard)
                n = robot_half_planes(i, now, limits[:, 0], aims, n_hard, planes)
                aim = turned_right(i, now, aim)
            out[b, i, 0], out[b, i, 1] = solve(planes, n, n_hard, limits[i, 1], aim)


def _payload_of(spec: TaskSpec) -> Payload:
    """The payload of a spec that this controller can serve.

    Raises:
        SpecError: it cannot, and why.
    """
    rules = spec.rules
    if not isinstance(rules, TransportRules):
        raise SpecError(f"rules.task is {rules.task!r}, expected 'transport'")
    if rules.goal_angle is not None:
        raise SpecError(
            f"rules.goal_angle is {rules.goal_angle:g}; the scripted policy of transport "
            "brings the payload to a position only. Leave goal_angle out."
        )
    for name, robot in zip(spec.agent_names, spec.robots, strict=True):
        if robot.dynamics != "holonomic":
            raise SpecError(
                f"{name} has {robot.dynamics} dynamics; the scripted policy of transport "
                "pushes with holonomic robots only, since it corrects their places sideways. "
                "Use dynamics: holonomic."
            )
    return rules.payload


class TransportScript:
    """Robots that push a payload together, for holonomic robots.

    It knows more than the robots see: the map and the positions and velocities of all.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each action component.

    Raises:
        SpecError: the task is not `transport` or has a goal angle, a robot is not holonomic, or
            `noise` is not a standard deviation.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        payload = _payload_of(spec)
        self._noise = check_noise(noise)
        self._last = LastMeans()
        self._size, self._dt = spec.action_size, spec.control_dt
        self._spec, self._shape, self._grid_shape = spec, shape_of(payload), grid_shape(spec)
        self._n_primitives = n_primitives(make_task(spec).kinds)
        self._half = np.array([spec.arena.width / 2.0, spec.arena.height / 2.0])
        radii = np.array([robot.radius for robot in spec.robots])
        self._limits = np.array(
            [
                (r.radius, r.max_speed, r.max_acceleration, radii.max() - r.radius)
                for r in spec.robots
            ]
        )
        self._by_velocity = np.array([r.command == "velocity" for r in spec.robots])
        need = 1.05 * payload.friction / self._limits[:, 2].min()
        reach = payload_radius(payload)
        self._payload = np.array(
            [
                payload.mass + spec.n_agents,
                payload.friction,
                self._limits[:, 2].min(),
                payload.friction * reach / 2.0,
                need,
                reach + SIDE_ROOM,
            ]
        )
        self._cap = max(reach + SIDE_ROOM, float(radii.max())) + 0.15
        self._allocate(0)

    def _allocate(self, n_copies: int) -> None:
        """Makes room for the maps of `n_copies` episodes; none is valid yet."""
        check_maps(self._spec, max(n_copies, 1), 2)
        nodes = (n_copies, self._grid_shape[0] * self._grid_shape[1])
        self._mapped = np.zeros(n_copies, dtype=np.bool_)
        self._seeds = np.zeros(n_copies, dtype=np.uint64)
        self._primitives = np.zeros((n_copies, self._n_primitives, 8), dtype=np.float32)
        self._grids = np.zeros((n_copies, *self._grid_shape), dtype=np.float32)
        self._ways = tuple(np.zeros(nodes, np.int32) for _ in range(4))
        self._planned: Double = np.zeros((n_copies, 2))
        self._memory: Int = np.zeros((n_copies, 4 + len(self._limits)), dtype=np.int64)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`, and forgets who was where."""
        if len(step.seeds) != len(self._seeds):
            self._allocate(len(step.seeds))
        for b in copies:
            self._primitives[b] = primitives_of(step.layouts[b])
            fill_clearances(step.layouts[b], self._half, self._cap, self._grids[b])
        self._ways[0][copies, 0] = self._ways[2][copies, 0] = UNPLANNED
        self._planned[copies] = np.inf
        self._memory[copies] = NONE
        self._seeds[copies], self._mapped[copies] = step.seeds[copies], True

    def act(self, step: Step) -> Float:
        e, n = len(step.seeds), len(self._limits)
        if e != len(self._seeds) or not (
            self._mapped.all() and np.array_equal(self._seeds, step.seeds)
        ):
            raise SchemaError(
                "the scripted policy has no map of some episodes of this step. Call "
                "policy.reset(step, copies) whenever the environment resets copies."
            )
        robots = robots_of(step.states, n).astype(np.float64)
        robots = np.ascontiguousarray(robots[..., [X, Y, VX, VY, TX, TY]])
        first = N_COLUMNS * n
        bodies = step.states[:, first : first + len(BODY)].astype(np.float64)
        velocities: Double = np.empty((e, n, 2))
        act_copies(
            robots, bodies, self._shape, self._limits, self._payload, self._dt, self._half,
            (self._primitives, self._grids), self._ways, self._planned, self._memory, velocities,
        )  # fmt: skip
        speeds, most = self._limits[:, 1:2], self._limits[:, 2:3]
        push = (velocities - robots[..., 2:4]) / (self._dt * most)
        commands = np.where(self._by_velocity[:, None], velocities / speeds, push)
        actions = np.zeros((e, n, self._size), dtype=np.float32)
        actions[..., :2] = add_noise(self._last.keep(step, commands), step, self._noise)
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self._last.require(step), actions, self._noise)
