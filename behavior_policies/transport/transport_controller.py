"""The pushing controller of `transport`, as a robotics engineer would write it.

1. The payload's path to its goal is planned as if it were its bounding circle (`planner`);
2. the one or two faces that point against the path's direction get slots for robots
   (`push_slots`); robots without a slot keep clear of the path;
3. robots go to their slots, around the payload and not through it (`payload_detour`), and wait;
4. when those in their slots can move the payload along its path without turning it, they push, by
   commanding velocities just above their own (`push_team`).

On their way robots avoid surfaces and each other as in `navigator`, in their slots only surfaces.
Faces, slots and whether robots push are remembered, so that small changes do not send robots around
the payload. It brings the payload to a position, and does not turn it to a wanted direction.
"""

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import (
    AVOIDANCE_HORIZON,
    ROBOT_GAP,
    robot_half_planes,
    surface_half_planes,
)
from swarmdata.behavior_policies.navigation.episode_maps import NODE_SPACING, EpisodeMaps, Maps
from swarmdata.behavior_policies.navigation.navigator import turned_right
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.noise import Controller
from swarmdata.behavior_policies.transport.payload_detour import (
    N_POINTS,
    Pushers,
    Rings,
    fill_rings,
)
from swarmdata.behavior_policies.transport.push_moves import (
    away_from_surfaces,
    follow_slot,
    go_to_slot,
    keep_clear,
    payload_half_plane,
)
from swarmdata.behavior_policies.transport.push_setup import PayloadState, PushSetup
from swarmdata.behavior_policies.transport.push_slots import (
    MAX_SLOTS,
    NO_INDEX,
    SlotSearch,
    choose_slots,
)
from swarmdata.behavior_policies.transport.push_team import (
    assign_slots,
    contact,
    feasible_direction,
    push_forces,
    stands,
)
from swarmdata.envs.transport.payload import place_row
from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.errors import SpecError
from swarmdata.numerics.distance_field import Ground
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.waypoints import UNPLANNED_COST, Paths, waypoint
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Int, Step

PAYLOAD_REPLAN_DISTANCE = 0.25  # m moved, before the robots' paths to it are planned anew

PAYLOAD_GOAL, ROBOTS_GOAL = range(2)
"""Goals of the maps: the payload's goal, and the payload as the goal of the robots."""

FIRST_FACE, SECOND_FACE, N_SLOTS, IS_PUSHING, FIRST_SLOT = range(5)
"""Columns of the memory; from the last on, the slot of each robot."""


@kernel
def _update_plan(robots: Double, search: SlotSearch, memory: Int, slots: Double) -> int:
    """Chooses faces and slots, and remembers them; returns the number of slots."""
    before = (memory[FIRST_FACE], memory[SECOND_FACE])
    first, second, k = choose_slots(search, before, slots)
    if (first, second) != before or k != memory[N_SLOTS]:
        memory[FIRST_FACE], memory[SECOND_FACE], memory[N_SLOTS] = first, second, k
        memory[IS_PUSHING], memory[FIRST_SLOT:] = 0, NO_INDEX
    if memory[IS_PUSHING] != 1:
        assign_slots(robots, search.payload, slots[:k], search.radius, memory[FIRST_SLOT:])
    return k


@kernel
def _update_pushing(
    robots: Double,
    payload: PayloadState,
    direction: tuple[float, float],
    setup: PushSetup,
    memory: Int,
    slots: Double,
    forces: Double,
) -> None:
    """Finds who is in its slot and whether they push; writes forces, NaN for the others, [N]."""
    n, is_circle = robots.shape[0], payload.shape[0] == CIRCLE
    pushes, indices = np.empty((n, 4)), np.empty(n, np.int64)
    found = 0
    forces[:] = np.nan
    for i in range(n):
        slot = memory[FIRST_SLOT + i]
        if slot < 0:
            continue
        nx, ny, left, off = contact(robots[i], setup.insets[i], payload, slots[slot])
        if stands(left, off, is_circle, memory[IS_PUSHING] == 1):
            indices[found] = i
            pushes[found, 0], pushes[found, 1] = robots[i, 0], robots[i, 1]
            pushes[found, 2], pushes[found, 3] = nx, ny
            found += 1
    feasible = feasible_direction(direction, slots)
    out = np.empty(n)
    memory[IS_PUSHING] = push_forces(payload.body, feasible, pushes[:found], setup, out)
    for f in range(found):
        forces[indices[f]] = out[f] if memory[IS_PUSHING] == 1 else 0.0


@kernel
def write_aims(
    robots: Double, search: SlotSearch, setup: PushSetup, paths: Paths, memory: Int, aims: Double
) -> None:
    """Writes what each robot would do alone, [N, 4]: velocity, m/s; way to go, m; 1 in its slot."""
    n, payload, direction, ground = robots.shape[0], search.payload, search.direction, search.ground
    slots, forces = np.empty((MAX_SLOTS, 4)), np.empty(n)
    k = _update_plan(robots, search, memory, slots)
    _update_pushing(robots, payload, direction, setup, memory, slots[:k], forces)
    pushers = Pushers(robots, ~np.isnan(forces))
    rings = Rings(np.empty((N_POINTS, 2)), np.empty(N_POINTS, np.bool_))
    fill_rings(payload, setup.max_radius, ground, rings)
    for i in range(n):
        slot = memory[FIRST_SLOT + i]
        aims[i, 3] = 1.0 if pushers.is_standing[i] else 0.0
        if slot < 0:
            keep_clear(i, robots[i], setup, payload.body, direction, aims[i])
        elif pushers.is_standing[i]:
            push = contact(robots[i], setup.insets[i], payload, slots[slot])
            follow_slot(robots[i], payload.body, push, forces[i], setup.control_dt, aims[i])
        else:
            go_to_slot(i, setup, payload, slots[slot], pushers, rings, ground, paths, aims[i])


@kernel
def act_copies(
    all_robots: Double, bodies: Double, setup: PushSetup, maps: Maps, memory: Int, out: Double
) -> None:
    """Writes the velocity of every robot of all copies, m/s, [E, N, 2].

    `all_robots`: columns x, y, vx, vy, goal x, goal y, [E, N, 6]. `bodies`: [E, 7]. `maps`: with
    paths to `PAYLOAD_GOAL` and `ROBOTS_GOAL`. `memory`: faces, number of slots, whether the robots
    push, slots of the robots, [E, 4 + N].
    """
    n_robots, radii, rule = all_robots.shape[1], setup.radii, (AVOIDANCE_HORIZON, ROBOT_GAP)
    planes = np.empty((maps.primitives.shape[1] + 5 + 2 * n_robots, 4))
    aims, row, scales = np.empty((n_robots, 4)), np.empty(8, np.float32), np.ones((n_robots, 2))
    for b in range(all_robots.shape[0]):
        robots, body, primitives = all_robots[b], bodies[b], maps.primitives[b]
        payload = PayloadState(body, setup.shape)
        ground = Ground(maps.clearances[b], maps.half, NODE_SPACING)
        planned = maps.goals[b, ROBOTS_GOAL]
        payload_paths = Paths(maps.costs[b, PAYLOAD_GOAL], maps.next_nodes[b, PAYLOAD_GOAL])
        robot_paths = Paths(maps.costs[b, ROBOTS_GOAL], maps.next_nodes[b, ROBOTS_GOAL])
        if abs(body[0] - planned[0]) + abs(body[1] - planned[1]) > PAYLOAD_REPLAN_DISTANCE:
            robot_paths.costs[0] = UNPLANNED_COST
            planned[0], planned[1] = body[0], body[1]
        position, goal = (body[0], body[1]), robots[0, 4:6]
        x, y = waypoint(position, goal, setup.path_radius, ground, payload_paths)
        aim = (x - body[0], y - body[1])
        direction = away_from_surfaces(body, aim, setup.path_radius, ground)
        search = SlotSearch(payload, direction, ground, n_robots, setup.max_radius, setup.n_needed)
        write_aims(robots, search, setup, robot_paths, memory[b], aims)
        place_row(body, setup.shape, row)
        for i in range(n_robots):
            x, y = robots[i, 0], robots[i, 1]
            n_hard = surface_half_planes(x, y, radii[i], primitives, maps.half, planes)
            n, aim = n_hard, (aims[i, 0], aims[i, 1])
            if aims[i, 3] == 0.0:
                n_hard = payload_half_plane(robots[i], radii[i], body, row, planes, n_hard)
                n = robot_half_planes(i, robots, radii, scales, aims, rule, n_hard, planes)
                aim = turned_right(i, robots, aim)
            out[b, i, 0], out[b, i, 1] = solve(planes, n, n_hard, setup.max_speeds[i], aim)


def _payload_of(spec: TaskSpec) -> Payload:
    rules = spec.rules_as(TransportRules)
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


class TransportController(Controller):
    """Makes holonomic robots push a payload together; it knows the map and all robots.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each action component.

    Raises:
        SpecError: the task is not `transport` or has a goal angle, a robot is not holonomic, or
            `noise` is not a standard deviation.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        self._setup = setup = PushSetup.of(spec, _payload_of(spec))
        super().__init__(spec, noise)
        self._maps = EpisodeMaps(spec, 2, max(setup.path_radius, setup.max_radius))
        self._by_velocity = np.array([robot.command == "velocity" for robot in spec.robots])
        accelerations = [robot.acceleration for robot in spec.robots]
        self._max_accelerations = np.array(accelerations)[:, None]  # [N, 1]
        self._memory: Int = np.zeros((0, FIRST_SLOT + spec.n_agents), dtype=np.int64)

    def reset(self, step: Step, copies: Int) -> None:
        super().reset(step, copies)
        self._maps.reset(step, copies)
        self._maps.forget_paths(copies)  # the payload's goal may be another
        if len(step.seeds) != len(self._memory):
            self._memory = np.zeros((len(step.seeds), self._memory.shape[1]), dtype=np.int64)
        self._memory[copies] = NO_INDEX

    def commands(self, step: Step) -> Double:
        setup, maps, n = self._setup, self._maps.maps, len(self._setup.radii)
        robots = robots_of(step.states, n).astype(np.float64)
        robots = np.ascontiguousarray(robots[..., [X, Y, VX, VY, TX, TY]])
        first = N_COLUMNS * n
        bodies = step.states[:, first : first + len(BODY)].astype(np.float64)
        velocities: Double = np.empty((len(robots), n, 2))
        act_copies(robots, bodies, setup, maps, self._memory, velocities)
        push = (velocities - robots[..., 2:4]) / (setup.control_dt * self._max_accelerations)
        by_speed = velocities / setup.max_speeds[:, None]
        return np.where(self._by_velocity[:, None], by_speed, push)
