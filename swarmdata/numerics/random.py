"""Counter-based random numbers: every draw is a pure function of (seed, stream, counters).

Only integer arithmetic and exact float operations are used: every platform gives the same bits. The
mixer is SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA
2014, figure 17).
"""

from collections.abc import Sequence
from functools import cache
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.types import Double, Int, Seeds

GOLDEN_GAMMA = 0x9E3779B97F4A7C15
MIX_1 = 0xBF58476D1CE4E5B9
MIX_2 = 0x94D049BB133111EB

_NAMES = ("layout", "policy", "noise", "channel", "sensor", "split", "reset", "body", "odometry")

STREAMS = {name: index for index, name in enumerate(_NAMES)}
"""Independent streams of one episode's seed."""

DRAW_MEANING = (
    "derive(s, a, b, ...): v = s; for each number c of a, b, ... in order, v = mix(v + (c + 1) "
    "0x9E3779B97F4A7C15); mix(z): z = z xor (z >> 30); z = z 0xBF58476D1CE4E5B9; z = z xor (z >> "
    "27); z = z 0x94D049BB133111EB; z = z xor (z >> 31); all in unsigned integers of 64 bits, "
    "which wrap. uniform(v) = floor(v / 2^11) / 2^53"
)
"""What `derive` and `uniform` compute, for readers who have neither."""

EVALUATION_BASE = 1 << 62
"""The first of the seeds that are reserved for evaluation and never appear in a dataset."""

VALIDATION_BASE = EVALUATION_BASE + (1 << 32)
"""The first of the seeds on which settings and checkpoints are chosen; in no dataset either."""

SeedBlock = Literal["evaluation", "validation"]
"""The reserved seeds, which are read once for a result, or those of every choice before it."""

NORMAL_BITS = 12


def mix(values: Seeds) -> Seeds:
    """Returns SplitMix64's output function of each 64-bit value."""
    z = values.astype(np.uint64, copy=True)
    z ^= z >> np.uint64(30)
    z *= np.uint64(MIX_1)
    z ^= z >> np.uint64(27)
    z *= np.uint64(MIX_2)
    z ^= z >> np.uint64(31)
    return z


def derive(seeds: Seeds | np.uint64 | int, *counters: Seeds | Int | np.uint64 | int) -> Seeds:
    """Returns one 64-bit value per broadcast element of `seeds` and `counters`.

    Different counters give independent values; the order of the counters matters.
    """
    value = np.asarray(seeds, dtype=np.uint64)
    with np.errstate(over="ignore"):
        for counter in counters:
            step = (np.asarray(counter, dtype=np.uint64) + np.uint64(1)) * np.uint64(GOLDEN_GAMMA)
            value = mix(np.atleast_1d(value + step))
    return value


def uniform(bits: Seeds) -> Double:
    """Returns multiples of 2**-53 in [0, 1) from 64-bit values."""
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


@cache
def normal_table() -> Double:
    """Returns the quantiles (k + 1/2) / 4096 of the normal, rounded to multiples of 2**-12.

    The rounding makes the table the same on every platform; its standard deviation is 0.9998.
    """
    n = 1 << NORMAL_BITS
    inverse = NormalDist().inv_cdf
    table = np.array([round(inverse((k + 0.5) / n) * n) / n for k in range(n)])
    table.setflags(write=False)
    return table


def normal(bits: Seeds) -> Double:
    """Returns draws from the discrete normal of `normal_table`, from 64-bit values."""
    return normal_table()[(bits >> np.uint64(64 - NORMAL_BITS)).astype(np.int64)]


def checked_seeds(given: Sequence[int] | NDArray[Any], *, distinct: bool = False) -> Seeds:
    """Returns the seeds of episodes, [n].

    Raises:
        SchemaError: they are no list of whole numbers from 0 on; or one is there twice, though they
            should be `distinct`.
    """
    found = np.asarray(given)
    are_whole = found.ndim == 1 and (
        bool(found.min(initial=0) >= 0)
        if found.dtype.kind in "iu"
        else all(_is_seed(each) for each in given)  # a list of large ones is an array of floats
    )
    if not are_whole or (distinct and len(np.unique(found)) < len(found)):
        raise SchemaError(
            f"the seeds are {given!r:.100}, expected a list of {'different ' * distinct}whole "
            "numbers, 0 to 2**64 - 1"
        )
    return np.asarray(given, dtype=np.uint64)


def _is_seed(value: object) -> bool:
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return is_whole and 0 <= int(value) < 1 << 64  # type: ignore[call-overload]


def evaluation_seeds(n_episodes: int) -> Seeds:
    """Returns the first `n_episodes` reserved evaluation seeds, [n_episodes]."""
    return np.arange(EVALUATION_BASE, EVALUATION_BASE + n_episodes, dtype=np.uint64)


def validation_seeds(n_episodes: int) -> Seeds:
    """Returns the first `n_episodes` seeds of the validation block, [n_episodes]."""
    return np.arange(VALIDATION_BASE, VALIDATION_BASE + n_episodes, dtype=np.uint64)


def block_seeds(block: SeedBlock, n_episodes: int) -> Seeds:
    """Returns the first `n_episodes` seeds of a block, [n_episodes].

    Raises:
        UnknownNameError: there is no such block.
    """
    blocks = {"evaluation": evaluation_seeds, "validation": validation_seeds}
    if block not in blocks:
        raise UnknownNameError("block of seeds", block, blocks)
    return blocks[block](n_episodes)
