"""Munk2D's own functions, called by address from compiled code, which costs a tenth of Pymunk's.

They are not part of Pymunk's public interface: `load_addresses` tells where they cannot be called.
"""

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from swarmdata.types import Int

MUNK_FUNCTIONS = (
    "cpSpaceStep", "cpBodySetForce", "cpBodyGetPosition", "cpBodyGetVelocity", "cpSpaceRemoveShape",
    "cpSpaceAddShape", "cpSpaceSetShapeIDCounter", "cpBodySetPosition", "cpBodySetVelocity",
    "cpCircleShapeSetRadius", "cpCircleShapeSetOffset", "cpPolyShapeSetVertsRaw",
    "cpBodyGetRotation", "cpBodyGetAngularVelocity", "cpBodyUpdatePosition", "cpBodySetAngle",
    "cpBodySetAngularVelocity", "cpConstraintSetMaxForce", "cpBodySetMass", "cpShapeSetFriction",
    "cpBodySetMoment",
)  # fmt: skip
STEP, SET_FORCE, GET_POSITION, GET_VELOCITY, REMOVE, ADD, SET_ID = range(7)
SET_POSITION, SET_VELOCITY, SET_RADIUS, SET_OFFSET, SET_VERTS = range(7, 12)
GET_ROTATION, GET_TURN_RATE, UPDATE_POSITION, SET_ANGLE, SET_TURN_RATE = range(12, 17)
SET_MAX_FORCE, SET_MASS, SET_FRICTION, SET_MOMENT = range(17, 21)  # indices of `MUNK_FUNCTIONS`

FLOAT64_TYPE = ir.DoubleType()


def load_addresses() -> Int | None:
    """The addresses of `MUNK_FUNCTIONS`, or None where they cannot be called, as on Windows."""
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
