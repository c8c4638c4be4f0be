"""Spaces of foreign environments as frozen data, and how their values become rows of numbers.

The layout of a row is fixed by the space alone: a box gives its values in C order, a discrete
space one column with the value, a dictionary its entries in the order of their sorted keys.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmdata.errors import SchemaError
from swarmdata.specs.frozen import Frozen
from swarmdata.types import Counts, Double, Float

Count = Annotated[int, Field(ge=1)]
Bound = float | None | tuple[float | None, ...]


class BoxSpace(Frozen):
    """Numbers of a fixed shape; a bound of None is infinite, one bound stands for all."""

    kind: Literal["box"] = "box"
    shape: tuple[Annotated[int, Field(ge=0)], ...]
    dtype: str  # of the environment; rows are float32
    low: Bound = None
    high: Bound = None


class DiscreteSpace(Frozen):
    """Whole numbers `start` to `start + n - 1`."""

    kind: Literal["discrete"] = "discrete"
    n: Count
    start: int = 0


class MultiDiscreteSpace(Frozen):
    """Several whole numbers, each from 0 to its n - 1."""

    kind: Literal["multi_discrete"] = "multi_discrete"
    n: Annotated[tuple[Count, ...], Field(min_length=1)]


class MultiBinarySpace(Frozen):
    """Several bits."""

    kind: Literal["multi_binary"] = "multi_binary"
    n: Count


class DictSpace(Frozen):
    """Named spaces."""

    kind: Literal["dict"] = "dict"
    spaces: dict[str, "Space"]


class TupleSpace(Frozen):
    """Spaces in order."""

    kind: Literal["tuple"] = "tuple"
    spaces: tuple["Space", ...]


Space = Annotated[
    BoxSpace | DiscreteSpace | MultiDiscreteSpace | MultiBinarySpace | DictSpace | TupleSpace,
    Field(discriminator="kind"),
]

LARGEST_EXACT_INTEGER = 1 << 24
"""The largest whole number up to which all are exact in float32."""


def width(space: Space) -> int:
    """Number of columns of a row."""
    match space:
        case BoxSpace():
            return math.prod(space.shape)
        case DiscreteSpace():
            return 1
        case MultiDiscreteSpace():
            return len(space.n)
        case MultiBinarySpace():
            return space.n
    return sum(map(width, _parts(space)))


def is_continuous(space: Space) -> bool:
    """Whether a space has boxes of real numbers only, and at least one number."""
    if isinstance(space, BoxSpace):
        return space.dtype.startswith("float")
    if isinstance(space, DictSpace | TupleSpace):
        return width(space) > 0 and all(map(is_continuous, _parts(space)))
    return False


def holds_bytes(space: Space) -> bool:
    """Whether a space has boxes of uint8 only, and at least one number, as images have."""
    if isinstance(space, BoxSpace):
        return space.dtype == "uint8"
    if isinstance(space, DictSpace | TupleSpace):
        return width(space) > 0 and all(map(holds_bytes, _parts(space)))
    return False


def as_bytes(rows: Float, where: str) -> Counts:
    """Returns whole numbers from 0 to 255 as uint8, of the same shape.

    Args:
        rows: the numbers.
        where: names them in errors.

    Raises:
        SchemaError: there are other numbers.
    """
    found = rows.clip(0, 255).astype(np.uint8)
    if (found != rows).any():
        raise SchemaError(
            f"{where} has numbers that are not whole or not from 0 to 255, although its space is "
            "of uint8"
        )
    return found


def flatten(space: Space, value: Any, where: str) -> Float:
    """Returns a value as one row, float32 [width(space)].

    Args:
        space: of the value.
        value: as the environment gives it.
        where: names the value in errors, such as "observation of adversary_0".

    Raises:
        SchemaError: the value is not of the space's structure or size, is not finite, or is a
            whole number that float32 cannot hold.
    """
    match space:
        case DictSpace():
            parts = [flatten(space.spaces[key], _entry(value, key, where), f"{where}[{key!r}]")
                     for key in sorted(space.spaces)]  # fmt: skip
            return _joined(parts)
        case TupleSpace():
            if len(value) != len(space.spaces):
                raise SchemaError(f"{where} has {len(value)} parts, expected {len(space.spaces)}")
            pairs = zip(space.spaces, value, strict=True)
            return _joined([flatten(s, v, f"{where}[{k}]") for k, (s, v) in enumerate(pairs)])
    array = np.asarray(value)
    if array.size != width(space) or array.dtype.kind not in "biuf":
        raise SchemaError(
            f"{where} has shape {array.shape} and dtype {array.dtype}, expected "
            f"{width(space)} numbers ({space})"
        )
    row: Float = array.reshape(-1).astype(np.float32)
    if not np.isfinite(row).all():
        raise SchemaError(f"{where} is not finite: {value}")
    if array.dtype.kind in "iu" and array.size and np.abs(row).max() > LARGEST_EXACT_INTEGER:
        raise SchemaError(f"{where} has whole numbers above {LARGEST_EXACT_INTEGER}: {value}")
    return row


def unflatten(space: Space, row: Float) -> Any:
    """Returns the value of a row from `flatten`, in the environment's structure and dtypes.

    Args:
        space: of the value.
        row: at least its columns, [>= width(space)]; further ones are padding.
    """
    match space:
        case DictSpace() | TupleSpace():
            ends = accumulate(map(width, _parts(space)))
            values = [unflatten(s, row[end - width(s) : end])
                      for s, end in zip(_parts(space), ends, strict=True)]  # fmt: skip
            if isinstance(space, TupleSpace):
                return tuple(values)
            return dict(zip(sorted(space.spaces), values, strict=True))
        case BoxSpace():
            return row[: width(space)].astype(space.dtype).reshape(space.shape)
        case DiscreteSpace():
            return int(row[0])
        case MultiDiscreteSpace():
            return row[: width(space)].astype(np.int64)
    return row[: width(space)].astype(np.int8)


def bounds(space: Space) -> tuple[Double, Double]:
    """Least and greatest value of each column, infinite where unbounded, [width(space)] each."""
    match space:
        case BoxSpace():
            return _filled(space.low, -math.inf, space), _filled(space.high, math.inf, space)
        case DiscreteSpace():
            return np.array([float(space.start)]), np.array([space.start + space.n - 1.0])
        case MultiDiscreteSpace():
            return np.zeros(len(space.n)), np.array(space.n, dtype=np.float64) - 1.0
        case MultiBinarySpace():
            return np.zeros(space.n), np.ones(space.n)
    pairs = [bounds(part) for part in _parts(space)]
    lows, highs = zip(*pairs, strict=True) if pairs else ((), ())
    empty = np.zeros(0)
    return np.concatenate([empty, *lows]), np.concatenate([empty, *highs])


def _filled(bound: Bound, infinite: float, space: BoxSpace) -> Double:
    values = bound if isinstance(bound, tuple) else (bound,)
    numbers = np.array([infinite if v is None else v for v in values], dtype=np.float64)
    return np.broadcast_to(numbers, (width(space),)).copy()


def _parts(space: "DictSpace | TupleSpace") -> tuple[Space, ...]:
    """The spaces inside, in the order of their columns."""
    if isinstance(space, TupleSpace):
        return space.spaces
    return tuple(space.spaces[key] for key in sorted(space.spaces))


def _entry(value: Mapping[str, Any], key: str, where: str) -> Any:
    if not isinstance(value, Mapping) or key not in value:
        raise SchemaError(f"{where} has no entry {key!r}, expected a mapping with it: {value!r}")
    return value[key]


def _joined(parts: list[NDArray[np.float32]]) -> Float:
    return np.concatenate([np.zeros(0, np.float32), *parts])


def stack_agents(rows: Sequence[NDArray[Any]]) -> Float:
    """Stacks one array [..., F_i] for each of N agents: [..., N, max F_i], zeros on the right.

    The result is uint8 if all of them are, else float32.
    """
    widest = max(each.shape[-1] for each in rows)
    dtype = np.uint8 if all(each.dtype == np.uint8 for each in rows) else np.float32
    stacked = np.zeros((*rows[0].shape[:-1], len(rows), widest), dtype=dtype)
    for agent, each in enumerate(rows):
        stacked[..., agent, : each.shape[-1]] = each
    return stacked
