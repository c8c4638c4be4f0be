"""Selection of the smallest of many numbers, one after the other, by vectorised loops.

Comparing floats one by one costs a mispredicted branch for every new minimum. For integers in the
order of the floats, the compiler vectorises the minimum.
"""

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Int

TAKEN_KEY = np.int64(np.iinfo(np.int64).max)
"""Key of a number that was taken: above that of any number."""


@kernel(inline="always")
def order_keys(keys: Int) -> None:
    """Turns the bits of float64 numbers, none NaN or -0, into integers of the same order, in place.

    The bits of positive floats are in the order of the floats, those of negative ones in reverse.
    """
    for m in range(keys.shape[0]):
        keys[m] ^= (keys[m] >> 63) & TAKEN_KEY


@kernel(inline="always")
def take_smallest(keys: Int) -> int:
    """Index of the smallest key, the first of equal ones; its key becomes `TAKEN`."""
    best = TAKEN_KEY
    for m in range(keys.shape[0]):
        best = min(best, keys[m])
    index = 0
    while keys[index] != best:
        index += 1
    keys[index] = TAKEN_KEY
    return index
