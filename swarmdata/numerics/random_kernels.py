"""The random numbers of `random` for compiled code: the same bits, one value at a time."""

import numpy as np

from swarmdata.numerics.random import GOLDEN_GAMMA, MIX_1, MIX_2, NORMAL_BITS
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

_GOLDEN, _MIX_1, _MIX_2 = np.uint64(GOLDEN_GAMMA), np.uint64(MIX_1), np.uint64(MIX_2)
_ONE, _SHIFT = np.uint64(1), np.uint64(64 - NORMAL_BITS)


@kernel(inline="always")
def absorb(value: np.uint64, counter: int) -> np.uint64:
    """One step of `random.derive`: `derive(s, a, b)` is `absorb(absorb(s, a), b)`."""
    z = value + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


@kernel(inline="always")
def to_uniform(bits: np.uint64) -> float:
    """A multiple of 2**-53 in [0, 1), as `random.uniform`."""
    return float(bits >> np.uint64(11)) * 2.0**-53


@kernel(inline="always")
def to_normal(bits: np.uint64, table: Double) -> float:
    """A draw from the discrete normal, as `random.normal`; `table` is `random.normal_table()`."""
    return float(table[np.int64(bits >> _SHIFT)])
