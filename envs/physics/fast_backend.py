"""The fast backend: E Pymunk spaces stepped by one numba loop that calls Munk2D by address.

Free motion needs no space. Where the solver has to start anew, the shapes of all moving bodies are
removed and added again (`_restart_solver`); the first time after a reset, everything in the space
is written (`_write_space`). Both are exact: the bits are those of a new space. So shapes are added
in build order, with the id counter at its value in a build, while robots are at rest, since
bounding boxes grow with velocity; the solver's hidden velocities and impulses are cleared.
"""

import math
from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np
import pymunk

from swarmdata.envs.physics.backend import Contacts, Moving, Plan, write_state
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.physics.dynamics import FRICTION, MASS, N_LIMITS, drive
from swarmdata.envs.physics.episode_bodies import (
    IS_ELLIPSOID,
    MOMENT,
    N_PAYLOAD,
    PAYLOAD_MASS,
    SLIDE_FRICTION,
    TURN_FRICTION,
    floor_grip,
)
from swarmdata.envs.physics.free_motion import is_free, move, write_travel_bounds
from swarmdata.envs.physics.impacts import time_to_impact
from swarmdata.envs.physics.munk_calls import (
    ADD,
    GET_POSITION,
    GET_ROTATION,
    GET_TURN_RATE,
    GET_VELOCITY,
    REMOVE,
    SET_ANGLE,
    SET_FORCE,
    SET_FRICTION,
    SET_ID,
    SET_MASS,
    SET_MAX_FORCE,
    SET_MOMENT,
    SET_OFFSET,
    SET_POSITION,
    SET_RADIUS,
    SET_TURN_RATE,
    SET_VELOCITY,
    SET_VERTS,
    STEP,
    UPDATE_POSITION,
    call_p_d,
    call_p_v,
    call_pd,
    call_pip,
    call_pp,
    call_pv,
)
from swarmdata.envs.physics.public_backend import bars, build_space, n_static_shapes, shapes_of
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.argument_blocks import ArgumentBlock, bundle_type, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int

UNWRITTEN = -1.0
"""Instead of the length of the solver's last step: the space is that of an earlier episode. A
length of 0 stands for free motion."""


class Spaces(NamedTuple):
    """The spaces of E copies, by address, and what is the same in all of their steps."""

    calls: Annotated[Int, 1]  # of `load_addresses`
    spaces: Annotated[Int, 1]  # [E]
    bodies: Annotated[Int, 2]  # [E, N + K] robots, then movable bodies
    shapes: Annotated[Int, 2]  # [E, any] in build order, those of `bodies` last
    joints: Annotated[Int, 2]  # [E, 2 K]
    payloads: Annotated[Double, 3]  # [E, K, 5] of `payload_rows`
    n_substeps: int  # physics steps in a control step
    dt: float  # s, of a physics step
    limits: Annotated[Double, 3]  # [E, N, 9] of `limits_of`
    radii: Annotated[Double, 1]  # [N] m
    half: Annotated[Double, 1]  # [2] half width and half height of the arena, m
    body_shapes: Annotated[Double, 2]  # [K, 3] of `shapes_of`
    robots: Annotated[Double, 3]  # [E, N, 6] columns as in `drive`
    movables: Annotated[Double, 3]  # [E, K, 7] columns `state_layout.BODY`
    solver_dt: Annotated[Double, 1]  # [E] s, of the solver's last step, 0 or `UNWRITTEN`


SPACES = bundle_type(Spaces)


@kernel
def _read_bodies(calls: Int, addresses: Int, movables: Double) -> None:
    """Reads the movable bodies of one copy, columns `state_layout.BODY`."""
    first = addresses.shape[0] - movables.shape[0]
    for k in range(movables.shape[0]):
        body = addresses[first + k]
        movables[k, 0], movables[k, 1] = call_p_v(calls[GET_POSITION], body)
        movables[k, 2], movables[k, 3] = call_p_v(calls[GET_VELOCITY], body)
        movables[k, 4], movables[k, 5] = call_p_v(calls[GET_ROTATION], body)
        movables[k, 6] = call_p_d(calls[GET_TURN_RATE], body)


@kernel(inline="always")
def _hold_payloads(calls: Int, joints: Int, payloads: Double, movables: Double) -> None:
    """Sets how the floor holds payloads where that depends on how they slide."""
    for k in range(movables.shape[0]):
        if payloads[k, IS_ELLIPSOID] == 1.0:
            force, torque = floor_grip(movables[k], payloads[k])
            call_pd(calls[SET_MAX_FORCE], joints[2 * k], force)
            call_pd(calls[SET_MAX_FORCE], joints[2 * k + 1], torque)


@kernel(inline="always")
def _step_space(
    calls: Int,
    space: int,
    bodies: Int,
    limits: Double,
    accelerations: Double,
    dt: float,
    robots: Double,
) -> None:
    for i in range(robots.shape[0]):  # Munk2D clears forces in every step
        mass = limits[i, MASS]
        x, y = mass * accelerations[i, 0], mass * accelerations[i, 1]
        call_pv(calls[SET_FORCE], bodies[i], x, y)
    call_pd(calls[STEP], space, dt)
    for i in range(robots.shape[0]):
        robots[i, 0], robots[i, 1] = call_p_v(calls[GET_POSITION], bodies[i])
        robots[i, 2], robots[i, 3] = call_p_v(calls[GET_VELOCITY], bodies[i])


@kernel
def _restart_solver(
    calls: Int, space: int, shapes: Int, bodies: Int, robots: Double, movables: Double, dt: float
) -> None:
    """Makes the solver forget all contacts; with movable bodies, overlap velocities go on."""
    n_moving = bodies.shape[0]
    first = shapes.shape[0] - n_moving
    for i in range(n_moving):
        call_pp(calls[REMOVE], space, shapes[first + i])
    if movables.shape[0] == 0:
        for i in range(n_moving):
            call_pd(calls[UPDATE_POSITION], bodies[i], dt)  # clears the overlap velocity
            call_pv(calls[SET_POSITION], bodies[i], robots[i, 0], robots[i, 1])
            call_pv(calls[SET_VELOCITY], bodies[i], 0.0, 0.0)
        call_pp(calls[SET_ID], space, first)
    for i in range(n_moving):
        call_pp(calls[ADD], space, shapes[first + i])
    if movables.shape[0] == 0:
        for i in range(n_moving):
            call_pv(calls[SET_VELOCITY], bodies[i], robots[i, 2], robots[i, 3])


@kernel
def _write_obstacles(calls: Int, shapes: Int, layout: Float) -> None:
    corners = np.empty((3, 4, 2))
    s = 4  # after the walls
    for m in range(layout.shape[0]):
        if layout[m, 0] == CIRCLE:
            call_pd(calls[SET_RADIUS], shapes[s], float(layout[m, 5]))
            call_pv(calls[SET_OFFSET], shapes[s], float(layout[m, 1]), float(layout[m, 2]))
            s += 1
        else:
            for k in range(bars(layout[m], corners)):
                call_pip(calls[SET_VERTS], shapes[s], 4, corners[k].ctypes.data)
                s += 1


@kernel
def _write_space(
    calls: Int,
    space: int,
    shapes: Int,
    bodies: Int,
    joints: Int,
    payloads: Double,
    layout: Float,
    robots: Double,
    movables: Double,
    limits: Double,
    dt: float,
) -> None:
    """Makes a used space what `build_space` would build."""
    n = robots.shape[0]
    first = shapes.shape[0] - bodies.shape[0]
    for shape in shapes:
        call_pp(calls[REMOVE], space, shape)
    for joint in joints:
        call_pd(calls[SET_MAX_FORCE], joint, 0.0)
    call_pd(calls[STEP], space, dt)  # clears overlap velocities, and impulses by forces of 0
    for i in range(n):
        call_pv(calls[SET_POSITION], bodies[i], robots[i, 0], robots[i, 1])
        call_pv(calls[SET_VELOCITY], bodies[i], 0.0, 0.0)
        call_pd(calls[SET_MASS], bodies[i], limits[i, MASS])
        call_pd(calls[SET_FRICTION], shapes[first + i], limits[i, FRICTION])
    for k in range(movables.shape[0]):
        body, row, load = bodies[n + k], movables[k], payloads[k]
        call_pd(calls[SET_MASS], body, load[PAYLOAD_MASS])
        call_pd(calls[SET_MOMENT], body, load[MOMENT])
        call_pd(calls[SET_MAX_FORCE], joints[2 * k], load[SLIDE_FRICTION])
        call_pd(calls[SET_MAX_FORCE], joints[2 * k + 1], load[TURN_FRICTION])
        call_pv(calls[SET_POSITION], body, row[0], row[1])
        call_pd(calls[SET_ANGLE], body, math.atan2(row[5], row[4]))
        call_pv(calls[SET_VELOCITY], body, 0.0, 0.0)
        call_pd(calls[SET_TURN_RATE], body, 0.0)
    _write_obstacles(calls, shapes, layout)
    call_pp(calls[SET_ID], space, 0)
    for shape in shapes:
        call_pp(calls[ADD], space, shape)
    for i in range(n):
        call_pv(calls[SET_VELOCITY], bodies[i], robots[i, 2], robots[i, 3])
    for k in range(movables.shape[0]):
        call_pv(calls[SET_VELOCITY], bodies[n + k], movables[k, 2], movables[k, 3])
        call_pd(calls[SET_TURN_RATE], bodies[n + k], movables[k, 6])


@kernel
def _advance(
    packed: Int,
    layouts: Float,
    active: Bool,
    commands: Double,
    touching: Bool,
    static: Bool,
    slack: Double,
    events: Counts,
    states: Float,
) -> None:
    """Advances the active copies of the packed `Spaces`; the rest is as in `Backend.step`."""
    (
        calls, spaces, bodies, shapes, joints, payloads, n_substeps, dt, limits, radii, half,
        body_shapes, robots, movables, solver_dt,
    ) = unpack(packed, SPACES)  # fmt: skip
    can_be_free = movables.shape[1] == 0
    accelerations, (travel, still) = np.zeros((radii.shape[0], 2)), np.zeros((2, radii.shape[0]))
    for b in range(spaces.shape[0]):
        if not active[b]:
            continue
        team, layout, gaps = robots[b], layouts[b], slack[b]
        is_certain = can_be_free and solver_dt[b] <= 0.0
        if is_certain:
            write_travel_bounds(team, limits[b], n_substeps * dt, travel)
            is_certain = is_free(team, 0.0, travel, radii, layout, half, gaps)
        for k in range(n_substeps):
            drive(team, commands[b], limits[b], n_substeps, dt, k, accelerations)
            if is_certain or (can_be_free and is_free(team, dt, still, radii, layout, half, gaps)):
                if solver_dt[b] > 0.0:
                    solver_dt[b], touching[b], static[b] = 0.0, False, False
                move(team, accelerations, dt)
                continue
            left = dt
            while left > 0.0:
                part = time_to_impact(
                    team, movables[b], left, dt, radii, body_shapes, layout, half, gaps
                )
                left -= part
                if solver_dt[b] < 0.0:
                    _write_space(
                        calls, spaces[b], shapes[b], bodies[b], joints[b], payloads[b], layout,
                        team, movables[b], limits[b], dt,
                    )  # fmt: skip
                elif part != solver_dt[b]:
                    _restart_solver(calls, spaces[b], shapes[b], bodies[b], team, movables[b], dt)
                solver_dt[b] = part
                _hold_payloads(calls, joints[b], payloads[b], movables[b])
                _step_space(calls, spaces[b], bodies[b], limits[b], accelerations, part, team)
                _read_bodies(calls, bodies[b], movables[b])
                update_contacts(team, radii, layout, half, touching[b], static[b], gaps, events[b])
        write_state(team, movables[b], states[b])


@cache
def integrates_exactly() -> bool:
    """Whether Munk2D moves free bodies as `move` does; not if its compiler fused operations."""
    values = np.random.default_rng(0).uniform(-1.0, 1.0, (16, 8))
    robots, accelerations, dt = values[:, :6].copy(), values[:, 6:], 0.05
    space, bodies = pymunk.Space(), [pymunk.Body(1.0, math.inf) for _ in robots]
    space.add(*bodies)
    for body, row, force in zip(bodies, robots.tolist(), accelerations.tolist(), strict=True):
        body.position, body.velocity, body.force = (row[0], row[1]), (row[2], row[3]), tuple(force)
    space.step(dt)
    move(robots, accelerations, dt)
    stepped = [(*body.position, *body.velocity) for body in bodies]
    return np.array_equal(np.array(stepped), robots[:, :4])


class FastBackend:
    """Implements `Backend` with Munk2D's own functions."""

    def __init__(self, plan: Plan, n_copies: int, calls: Int) -> None:
        self._plan, spec = plan, plan.spec
        n, k = spec.n_agents, len(plan.movables)
        n_shapes = 4 + n_static_shapes(plan.kinds) + n + k
        self.spaces = Spaces(
            calls=calls,
            spaces=np.zeros(n_copies, dtype=np.int64),
            bodies=np.zeros((n_copies, n + k), dtype=np.int64),
            shapes=np.zeros((n_copies, n_shapes), dtype=np.int64),
            joints=np.zeros((n_copies, 2 * k), dtype=np.int64),
            payloads=np.zeros((n_copies, k, N_PAYLOAD)),
            n_substeps=spec.n_substeps,
            dt=spec.physics_dt,
            limits=np.zeros((n_copies, n, N_LIMITS)),
            radii=np.array([robot.radius for robot in spec.robots]),
            half=np.array(spec.half_size),
            body_shapes=shapes_of(plan),
            robots=np.zeros((n_copies, n, 6)),
            movables=np.zeros((n_copies, k, 7)),
            solver_dt=np.zeros(n_copies),
        )
        self._block = ArgumentBlock(self.spaces, SPACES)
        self._owners: list[Any] = [None] * n_copies  # keep alive what the addresses point to
        self._layouts: Float | None = None

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        self._layouts = layouts
        ours = self.spaces
        ours.robots[copies], ours.movables[copies] = moving.robots, moving.bodies
        ours.limits[copies], ours.payloads[copies] = moving.limits, moving.payloads
        ours.solver_dt[copies] = UNWRITTEN
        for b in copies.tolist():
            if self._owners[b] is None:
                self._build(b, layouts[b])

    def _build(self, b: int, layout: Float) -> None:
        from pymunk._chipmunk_cffi import ffi  # noqa: PLC0415  (checked by load_addresses)

        def address(pointer: Any) -> int:
            return int(ffi.cast("uintptr_t", pointer))

        ours = self.spaces
        space, bodies = build_space(
            self._plan, layout, ours.robots[b], ours.movables[b], ours.limits[b], ours.payloads[b]
        )
        self._owners[b] = space, bodies
        ours.spaces[b] = address(space._space)
        ours.bodies[b] = [address(body._body) for body in bodies]
        ours.shapes[b] = [address(shape._shape) for shape in space.shapes]
        ours.joints[b] = [address(joint._constraint) for joint in space.constraints]

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        if self._layouts is None:
            raise RuntimeError("the world was stepped before its first reset")
        _advance(self._block.packed, self._layouts, active, commands, *contacts, events, states)
