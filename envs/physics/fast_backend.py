"""The fast backend: E Pymunk spaces stepped by one numba loop that calls Munk2D by address.

Pymunk's attribute access costs ten times more than the physics. Its compiled module exports the
functions that it wraps, so compiled code can call them directly: set the forces, step, read the
bodies, find the contacts, one space after the other while it is in the cache.

Free motion needs no call at all. The first other step after it begins with a new solver: the shapes
of the robots are removed, the solver's hidden overlap velocities cleared, and the shapes added at
rest in build order with the id counter at its value in a build; only then robots get their
velocities. A reset does the same with all shapes. With anything less, the past would change bits.
"""

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from swarmdata.envs.physics.backend import Contacts, Plan, write_state
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.physics.dynamics import drive, limits_of
from swarmdata.envs.physics.free_motion import is_free, move, write_travel_bounds
from swarmdata.envs.physics.impacts import time_to_impact
from swarmdata.envs.physics.public_backend import bars, build_space, n_static_shapes, shapes_of
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Double, Float, Int

MUNK_FUNCTIONS = (
    "cpSpaceStep",
    "cpBodySetForce",
    "cpBodyGetPosition",
    "cpBodyGetVelocity",
    "cpSpaceRemoveShape",
    "cpSpaceAddShape",
    "cpSpaceSetShapeIDCounter",
    "cpBodySetPosition",
    "cpBodySetVelocity",
    "cpCircleShapeSetRadius",
    "cpCircleShapeSetOffset",
    "cpPolyShapeSetVertsRaw",
    "cpBodyGetRotation",
    "cpBodyGetAngularVelocity",
    "cpBodyUpdatePosition",
)
STEP, SET_FORCE, GET_POSITION, GET_VELOCITY, REMOVE, ADD, SET_ID = range(7)
SET_POSITION, SET_VELOCITY, SET_RADIUS, SET_OFFSET, SET_VERTS = range(7, 12)
GET_ROTATION, GET_TURN_RATE, UPDATE_POSITION = range(12, 15)

FLOAT64_TYPE = ir.DoubleType()


def load_addresses() -> Int | None:
    """Returns the addresses of `MUNK_FUNCTIONS`, or None where they cannot be called.

    They are not part of Pymunk's public interface. On Windows a vector is passed in another way
    than here.
    """
    if sys.platform == "win32" or sys.maxsize < 2**32:
        return None
    try:
        from pymunk._chipmunk_cffi import ffi, lib  # noqa: PLC0415  (private, may be absent)

        found = [int(ffi.cast("uintptr_t", ffi.addressof(lib, name))) for name in MUNK_FUNCTIONS]
    except (ImportError, AttributeError):
        return None
    return np.array(found, dtype=np.int64)


def _call(builder: Any, address: Any, result: Any, arguments: list[Any]) -> Any:
    signature = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(builder.inttoptr(address, signature.as_pointer()), arguments)


def _void_call(*kinds: Any) -> tuple[Any, Any]:
    """Returns signature and code of a call, by address, of a `void` function of such arguments."""

    def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        _call(builder, args[0], ir.VoidType(), list(args[1:]))
        return context.get_dummy_value()

    return types.void(types.int64, *kinds), generate


@intrinsic
def call_pd(_context: Any, address: Any, pointer: Any, value: Any) -> Any:
    """Calls a `void f(void *, double)`."""
    return _void_call(types.int64, types.float64)


@intrinsic
def call_pv(_context: Any, address: Any, pointer: Any, x: Any, y: Any) -> Any:
    """Calls a `void f(void *, cpVect)`: the two doubles travel in registers."""
    return _void_call(types.int64, types.float64, types.float64)


@intrinsic
def call_pp(_context: Any, address: Any, pointer: Any, value: Any) -> Any:
    """Calls a `void f(void *, void *)`, or with an integer of that width."""
    return _void_call(types.int64, types.int64)


@intrinsic
def call_pip(_context: Any, address: Any, pointer: Any, count: Any, data: Any) -> Any:
    """Calls a `void f(void *, int, void *)`."""
    return _void_call(types.int64, types.int32, types.int64)


@intrinsic
def call_p_v(_context: Any, address: Any, pointer: Any) -> Any:
    """Calls a `cpVect f(void *)`."""
    result = types.UniTuple(types.float64, 2)

    def generate(_ctx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        pair = ir.LiteralStructType([FLOAT64_TYPE, FLOAT64_TYPE])
        vector = _call(builder, args[0], pair, [args[1]])
        out = ir.Constant(ir.ArrayType(FLOAT64_TYPE, 2), ir.Undefined)
        for k in range(2):
            out = builder.insert_value(out, builder.extract_value(vector, k), k)
        return out

    return result(types.int64, types.int64), generate


@intrinsic
def call_p_d(_context: Any, address: Any, pointer: Any) -> Any:
    """Calls a `double f(void *)`."""

    def generate(_ctx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _call(builder, args[0], FLOAT64_TYPE, [args[1]])

    return types.float64(types.int64, types.int64), generate


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
def _step_space(
    calls: Int, space: int, bodies: Int, accelerations: Double, dt: float, robots: Double
) -> None:
    """Makes one step of Munk2D and reads the robots."""
    for i in range(robots.shape[0]):  # Munk2D clears forces in every step
        call_pv(calls[SET_FORCE], bodies[i], accelerations[i, 0], accelerations[i, 1])
    call_pd(calls[STEP], space, dt)
    for i in range(robots.shape[0]):
        robots[i, 0], robots[i, 1] = call_p_v(calls[GET_POSITION], bodies[i])
        robots[i, 2], robots[i, 3] = call_p_v(calls[GET_VELOCITY], bodies[i])


@kernel
def _restart_solver(
    calls: Int, space: int, shapes: Int, bodies: Int, robots: Double, movables: Double, dt: float
) -> None:
    """Puts the moving bodies into the space as if they were new; joints keep their impulses."""
    n_moving = bodies.shape[0]
    first = shapes.shape[0] - n_moving
    for i in range(n_moving):
        call_pp(calls[REMOVE], space, shapes[first + i])
    if movables.shape[0] == 0:
        for i in range(n_moving):
            call_pd(calls[UPDATE_POSITION], bodies[i], dt)  # clears the overlap velocity
            call_pv(calls[SET_POSITION], bodies[i], robots[i, 0], robots[i, 1])
            call_pv(calls[SET_VELOCITY], bodies[i], 0.0, 0.0)  # bounding boxes grow with velocity
        call_pp(calls[SET_ID], space, first)
    for i in range(n_moving):
        call_pp(calls[ADD], space, shapes[first + i])
    if movables.shape[0] == 0:
        for i in range(n_moving):
            call_pv(calls[SET_VELOCITY], bodies[i], robots[i, 2], robots[i, 3])


@kernel
def _advance(
    calls: Int,
    spaces: Int,
    bodies: Int,
    shapes: Int,
    n_substeps: int,
    dt: float,
    limits: Double,
    radii: Double,
    half: Double,
    body_shapes: Double,
    robots: Double,
    movables: Double,
    solver_dt: Double,
    accelerations: Double,
    travel: Double,
    layouts: Float,
    active: Bool,
    commands: Double,
    touching: Bool,
    static: Bool,
    slack: Double,
    events: Counts,
    states: Float,
) -> None:
    """Advances the active copies; takes plain arguments since tuples of arrays are slow to pass."""
    can_be_free = movables.shape[1] == 0
    for b in range(spaces.shape[0]):
        if not active[b]:
            continue
        team, layout, gaps = robots[b], layouts[b], slack[b]
        is_certain = False
        if can_be_free and solver_dt[b] == 0.0:
            write_travel_bounds(team, limits, n_substeps * dt, travel)
            is_certain = is_free(team, 0.0, travel, radii, layout, half, gaps)
            travel[:] = 0.0
        for k in range(n_substeps):
            drive(team, commands[b], limits, n_substeps, dt, k, accelerations)
            if is_certain or (can_be_free and is_free(team, dt, travel, radii, layout, half, gaps)):
                if solver_dt[b] != 0.0:
                    solver_dt[b], touching[b], static[b] = 0.0, False, False
                move(team, accelerations, dt)
                continue
            left = dt
            while left > 0.0:
                part = time_to_impact(
                    team, movables[b], left, dt, radii, body_shapes, layout, half, gaps
                )
                left -= part
                if part != solver_dt[b]:
                    solver_dt[b] = part
                    _restart_solver(calls, spaces[b], shapes[b], bodies[b], team, movables[b], dt)
                _step_space(calls, spaces[b], bodies[b], accelerations, part, team)
                _read_bodies(calls, bodies[b], movables[b])
                update_contacts(team, radii, layout, half, touching[b], static[b], gaps, events[b])
        write_state(team, movables[b], states[b])


@kernel
def _reset_one(
    calls: Int,
    space: int,
    shapes: Int,
    bodies: Int,
    layout: Float,
    corners: Double,
    starts: Double,
    dt: float,
) -> None:
    for shape in shapes:
        call_pp(calls[REMOVE], space, shape)
    call_pd(calls[STEP], space, dt)
    for i in range(starts.shape[0]):
        call_pv(calls[SET_POSITION], bodies[i], starts[i, 0], starts[i, 1])
        call_pv(calls[SET_VELOCITY], bodies[i], 0.0, 0.0)
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
    call_pp(calls[SET_ID], space, 0)
    for shape in shapes:
        call_pp(calls[ADD], space, shape)


class FastBackend:
    """Implements `Backend` with Munk2D's own functions."""

    def __init__(self, plan: Plan, n_copies: int, calls: Int) -> None:
        self._plan, self._calls, spec = plan, calls, plan.spec
        self._timing = spec.n_substeps, spec.physics_dt
        self._limits = limits_of(spec)
        self._radii = np.array([robot.radius for robot in spec.robots])
        self._half = np.array(spec.half_size)
        self._owners: list[Any] = [None] * n_copies  # keep alive what the addresses point to
        self._spaces = np.zeros(n_copies, dtype=np.int64)
        n, k = spec.n_agents, len(plan.movables)
        self._bodies = np.zeros((n_copies, n + k), dtype=np.int64)
        n_shapes = 4 + n_static_shapes(plan.kinds) + n + k
        self._shapes = np.zeros((n_copies, n_shapes), dtype=np.int64)
        self._corners: Double = np.empty((3, 4, 2))
        self._layouts: Float | None = None
        self._robots: Double = np.zeros((n_copies, n, 6))
        self._movables: Double = np.zeros((n_copies, k, 7))
        self._solver_dt: Double = np.zeros(n_copies)  # of its last step; 0 after free motion
        accelerations, travel = np.zeros((n, 2)), np.zeros(n)
        self._fixed = (
            calls, self._spaces, self._bodies, self._shapes, *self._timing, self._limits,
            self._radii, self._half, shapes_of(plan), self._robots, self._movables,
            self._solver_dt, accelerations, travel,
        )  # fmt: skip

    def reset(self, copies: Int, layouts: Float, robots: Double, bodies: Double) -> None:
        self._layouts = layouts
        for b in copies.tolist():
            if self._owners[b] is None or self._plan.movables:  # joints keep hidden impulses
                self._build(b, layouts[b], robots[b], bodies[b])
            else:
                _reset_one(
                    self._calls, self._spaces[b], self._shapes[b], self._bodies[b],
                    layouts[b], self._corners, robots[b], self._timing[1],
                )  # fmt: skip
        self._robots[copies], self._movables[copies] = robots[copies], bodies[copies]
        self._solver_dt[copies] = 0.0

    def _build(self, b: int, layout: Float, robots: Double, movables: Double) -> None:
        from pymunk._chipmunk_cffi import ffi  # noqa: PLC0415  (checked by load_addresses)

        def address(pointer: Any) -> int:
            return int(ffi.cast("uintptr_t", pointer))

        space, bodies = build_space(self._plan, layout, robots, movables)
        self._owners[b] = space, bodies
        self._spaces[b] = address(space._space)
        self._bodies[b] = [address(body._body) for body in bodies]
        self._shapes[b] = [address(shape._shape) for shape in space.shapes]

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        if self._layouts is None:
            raise RuntimeError("the world was stepped before its first reset")
        _advance(*self._fixed, self._layouts, active, commands, *contacts, events, states)
