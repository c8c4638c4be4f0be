"""The fast backend: E Pymunk spaces stepped by one numba loop that calls Munk2D by address.

Pymunk's attribute access costs ten times more than the physics. The functions it wraps are exported
by its compiled module, so compiled code can call them directly: set the forces, step, read the
bodies, find contacts, one space after the other while it is in cache.

The reset is exact: it removes every shape, steps once (the only way to clear the solver's hidden
overlap velocities), writes bodies and obstacles, and adds the shapes back in build order with the
id counter at its start. Anything less lets the previous episode change the next one's bits.
"""

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from swarmdata.envs.backend import Contacts
from swarmdata.envs.contacts import update_contacts
from swarmdata.envs.pymunk_space import bars, build_space, n_static_shapes
from swarmdata.geometry import CIRCLE
from swarmdata.spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int

NAMES = (
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
)
STEP, SET_FORCE, GET_POSITION, GET_VELOCITY, REMOVE, ADD, SET_ID = range(7)
SET_POSITION, SET_VELOCITY, SET_RADIUS, SET_OFFSET, SET_VERTS = range(7, 12)

F64 = ir.DoubleType()


def load_addresses() -> Int | None:
    """Addresses of `NAMES` in Pymunk's compiled module, or None where they cannot be called.

    They are not part of Pymunk's public interface. On Windows a vector is passed in another way
    than here.
    """
    if sys.platform == "win32" or sys.maxsize < 2**32:
        return None
    try:
        from pymunk._chipmunk_cffi import ffi, lib  # noqa: PLC0415  (private, may be absent)

        found = [int(ffi.cast("uintptr_t", ffi.addressof(lib, name))) for name in NAMES]
    except (ImportError, AttributeError):
        return None
    return np.array(found, dtype=np.int64)


def _call(builder: Any, address: Any, result: Any, arguments: list[Any]) -> Any:
    signature = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(builder.inttoptr(address, signature.as_pointer()), arguments)


def _void_call(*kinds: Any) -> tuple[Any, Any]:
    """Signature and code of a call, by address, of a `void` function of such arguments."""

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
        vector = _call(builder, args[0], ir.LiteralStructType([F64, F64]), [args[1]])
        out = ir.Constant(ir.ArrayType(F64, 2), ir.Undefined)
        for k in range(2):
            out = builder.insert_value(out, builder.extract_value(vector, k), k)
        return out

    return result(types.int64, types.int64), generate


@njit(nogil=True, cache=True)
def _advance(
    calls: Int,
    spaces: Int,
    bodies: Int,
    active: Bool,
    accelerations: Double,
    timing: tuple[int, float],
    world: tuple[Double, Double, Float],
    moving: tuple[Double, Double],
    contacts: Contacts,
) -> None:
    n_substeps, dt = timing
    radii, half, layouts = world
    positions, velocities = moving
    n = radii.shape[0]
    for b in range(spaces.shape[0]):
        if not active[b]:
            continue
        contacts.events[b] = 0
        for _ in range(n_substeps):
            for i in range(n):  # Munk2D clears forces in every step
                call_pv(
                    calls[SET_FORCE], bodies[b, i], accelerations[b, i, 0], accelerations[b, i, 1]
                )
            call_pd(calls[STEP], spaces[b], dt)
            for i in range(n):
                positions[b, i, 0], positions[b, i, 1] = call_p_v(calls[GET_POSITION], bodies[b, i])
            update_contacts(
                positions[b], radii, layouts[b], half,
                contacts.robots[b], contacts.obstacles[b], contacts.slack[b], contacts.events[b],
            )  # fmt: skip
        for i in range(n):
            velocities[b, i, 0], velocities[b, i, 1] = call_p_v(calls[GET_VELOCITY], bodies[b, i])


@njit(nogil=True, cache=True)
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
    for i in range(bodies.shape[0]):
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


class MunkBackend:
    """The backend interface over Munk2D's own functions."""

    def __init__(self, spec: TaskSpec, n_copies: int, calls: Int) -> None:
        self._spec, self._calls = spec, calls
        self._radii = np.array([robot.radius for robot in spec.robots])
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self._keep: list[Any] = [None] * n_copies  # owns what the addresses point to
        self._spaces = np.zeros(n_copies, dtype=np.int64)
        self._bodies = np.zeros((n_copies, spec.n_agents), dtype=np.int64)
        n_shapes = 4 + n_static_shapes(spec) + spec.n_agents
        self._shapes = np.zeros((n_copies, n_shapes), dtype=np.int64)
        self._corners: Double = np.empty((3, 4, 2))
        self._layouts: Float | None = None
        self.positions: Double = np.zeros((n_copies, spec.n_agents, 2))
        self.velocities: Double = np.zeros((n_copies, spec.n_agents, 2))

    def reset(self, copies: Int, layouts: Float, starts: Double) -> None:
        self._layouts = layouts
        for b in copies.tolist():
            if self._keep[b] is None:
                self._build(b, layouts[b], starts[b])
            else:
                _reset_one(
                    self._calls, self._spaces[b], self._shapes[b], self._bodies[b],
                    layouts[b], self._corners, starts[b], self._spec.physics_dt,
                )  # fmt: skip
        self.positions[copies] = starts[copies]
        self.velocities[copies] = 0.0

    def _build(self, b: int, layout: Float, starts: Double) -> None:
        from pymunk._chipmunk_cffi import ffi  # noqa: PLC0415  (checked by load_addresses)

        def address(pointer: Any) -> int:
            return int(ffi.cast("uintptr_t", pointer))

        space, bodies = build_space(self._spec, layout, starts)
        self._keep[b] = space, bodies
        self._spaces[b] = address(space._space)
        self._bodies[b] = [address(body._body) for body in bodies]
        self._shapes[b] = [address(shape._shape) for shape in space.shapes]

    def step(self, active: Bool, accelerations: Double, contacts: Contacts) -> None:
        if self._layouts is None:
            raise RuntimeError("the world was stepped before its first reset")
        _advance(
            self._calls, self._spaces, self._bodies, active, accelerations,
            (self._spec.n_substeps, self._spec.physics_dt),
            (self._radii, self._half, self._layouts), (self.positions, self.velocities), contacts,
        )  # fmt: skip
