"""Arguments of kernels that stay the same from call to call, passed as one array of addresses.

For each array from Python numba takes 60 ns, and a small world has dozens; here it is a few loads.
"""

from collections.abc import Iterator
from itertools import count
from typing import Annotated, Any, NoReturn, get_args, get_origin, get_type_hints

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from swarmdata.errors import SchemaError
from swarmdata.types import Bool, Double, Float, Int

_SCALARS = {bool: types.boolean, int: types.int64, float: types.float64}

_ITEMS = {Bool: types.boolean, Int: types.int64, Float: types.float32, Double: types.float64}
"""What arrays hold, by our alias: what NumPy's alias is made of depends on its release."""


def bundle_type(bundle: type[tuple[Any, ...]]) -> types.NamedTuple:
    """Returns numba's type of a NamedTuple, from its annotations.

    Args:
        bundle: its fields are `bool`, `int`, `float`, or C-contiguous arrays of `swarmdata.types`,
            such as `Annotated[Double, 2]` for one with two axes.
    """
    hints = get_type_hints(bundle, include_extras=True)
    return types.NamedTuple([_field_type(hint) for hint in hints.values()], bundle)


def _field_type(hint: Any) -> types.Type:
    if get_origin(hint) is not Annotated:
        return _SCALARS[hint]
    array, n_axes = get_args(hint)
    return types.Array(_ITEMS[array], n_axes, "C")


class ArgumentBlock:
    """A bundle, and what kernels get of it; the arrays live as long as the block.

    A kernel that is called with `ArgumentBlock(drive, DRIVE).packed` begins with `drive =
    unpack(packed, DRIVE)`, where `DRIVE` is `bundle_type(Drive)` of the NamedTuple `Drive`.

    Raises:
        TypeError: an argument is not of its type.
    """

    def __init__(self, bundle: Any, kind: types.NamedTuple) -> None:
        self._bundle = bundle
        words = [
            word
            for name, value, expected in zip(kind.fields, bundle, kind.types, strict=True)
            for word in _words(name, value, expected)
        ]
        # of each array its address and shape, of each number its bits
        self.packed: Int = np.array(words, dtype=np.int64)

    def __reduce__(self) -> NoReturn:
        """Refuses `copy` and `pickle`: a copy would hold the addresses of this one's arrays."""
        raise SchemaError(
            "environments, and policies that compute in compiled code, cannot be copied or "
            "pickled: they hold addresses in memory. Make another one instead; an environment "
            "that is reset with the same seeds and takes the same actions gets to the same state."
        )


def _words(name: str, value: Any, expected: types.Type) -> Iterator[int]:
    found = numba.typeof(value)
    if found != expected:
        raise TypeError(f"argument {name} is {found}, expected {expected}: mend its annotation")
    if isinstance(expected, types.Array):
        yield value.ctypes.data
        yield from value.shape
    elif isinstance(expected, types.Float):
        yield int(np.float64(value).view(np.int64))
    else:
        yield int(value)


@intrinsic
def unpack(_context: Any, packed: Any, kind: Any) -> Any:
    """In a kernel: the bundle of an `ArgumentBlock`, whose type `kind` must be a constant."""
    bundle = kind.instance_type

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        words = (builder.load(cgutils.gep(builder, data, at)) for at in count())
        values = [_read(context, builder, words, field) for field in bundle.types]
        return context.make_tuple(builder, bundle, values)

    return bundle(packed, kind), generate


def _read(context: Any, builder: Any, words: Iterator[Any], kind: types.Type) -> Any:
    """Generates code that reads a value, which takes one word after another."""
    word = next(words)
    if isinstance(kind, types.Float):
        return builder.bitcast(word, context.get_value_type(kind))
    if not isinstance(kind, types.Array):
        return context.cast(builder, word, types.int64, kind)
    array = context.make_array(kind)(context, builder)
    shape = [next(words) for _ in range(kind.ndim)]
    size = context.get_constant(
        types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype))
    )
    strides = [size]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    pointer = builder.inttoptr(word, context.get_data_type(kind.dtype).as_pointer())
    populate_array(array, pointer, shape, strides, size, meminfo=None)
    return array._getvalue()
