"""Spaces of foreign environments as frozen data, and how their values become rows of numbers.

Columns are a box's in C order, one of a discrete space, a dictionary's by sorted keys.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmdata.errors import SchemaError, SpecError
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

LARGEST_EXACT_INTEGER = 1 << 24  # the largest whole number up to which all are exact in float32


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
    return sum(map(width, parts_of(space)))


def n_choices(space: Space) -> int:
    """Number of entries of an action mask; 0 for actions that are not discrete."""
    if isinstance(space, DiscreteSpace):
        return space.n
    return sum(space.n) if isinstance(space, MultiDiscreteSpace) else 0


def existing_choices(spaces: Sequence[Space]) -> NDArray[np.bool_]:
    """Which entries of the action masks of several agents are choices, not padding, [N, C]."""
    counts = np.array([n_choices(space) for space in spaces])
    exist: NDArray[np.bool_] = np.arange(counts.max()) < counts[:, None]
    return exist


def is_continuous(space: Space) -> bool:
    """Whether a space has boxes of real numbers only, and at least one number."""
    return _has_boxes_of(space, "float")


def holds_bytes(space: Space) -> bool:
    """Whether a space has boxes of uint8 only, and at least one number, as images have."""
    return _has_boxes_of(space, "uint8")


def _has_boxes_of(space: Space, dtype: str) -> bool:
    if isinstance(space, BoxSpace):
        return space.dtype.startswith(dtype)
    if isinstance(space, DictSpace | TupleSpace):
        return width(space) > 0 and all(_has_boxes_of(part, dtype) for part in parts_of(space))
    return False


def as_bytes(rows: Float, where: str) -> Counts:
    """Returns whole numbers from 0 to 255 as uint8, of the same shape.

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


def to_float32(values: Any, where: str) -> Float:
    """Returns numbers as float32 of the same shape, without changing what they say.

    Numbers up to `LARGEST_EXACT_INTEGER` are rounded; larger ones, such as seconds since 1970,
    would lose whole units. Errors call them `where`, such as "reward of agent_0".

    Raises:
        SchemaError: they are no real numbers, are not finite in float32, or would be changed.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise SchemaError(f"{where} has values of type {array.dtype}, expected real numbers")
    with np.errstate(over="ignore"):
        rows: Float = array.astype(np.float32)
    if array.dtype.kind == "f":
        _refuse(~np.isfinite(rows), array, f"{where} is not finite", "finite float32 numbers")
    if array.dtype.kind == "f" and array.dtype.itemsize > 4:
        changed = (np.abs(rows) > LARGEST_EXACT_INTEGER) & (rows != array)
    elif array.dtype.kind in "iu" and array.dtype.itemsize > 2:
        changed = np.abs(rows) > LARGEST_EXACT_INTEGER
    else:
        return rows
    what = f"{where} has numbers above {LARGEST_EXACT_INTEGER}, which float32 would round"
    _refuse(changed, array, what, "smaller ones: subtract an offset, or use another unit")
    return rows


def _refuse(wrong: NDArray[np.bool_], array: NDArray[Any], what: str, expected: str) -> None:
    """Raises SchemaError if anything is wrong; names the first such number and its place."""
    if not wrong.any():
        return
    place = tuple(int(k) for k in np.argwhere(wrong)[0])
    at = f" at {list(place)}" if place else ""
    raise SchemaError(f"{what}: {array[place].item()!r}{at}, expected {expected}")


def flatten(space: Space, value: Any, where: str, batch: tuple[int, ...] = ()) -> Float:
    """Returns a value as a row of float32, [*batch, width(space)].

    Args:
        space: of the value.
        value: as the environment gives it; its arrays begin with the axes of `batch`.
        where: names the value in errors, such as "observation of adversary_0".
        batch: axes of several values; none of one.

    Raises:
        SchemaError: the value is not of the space's structure or size, or float32 cannot hold it
            (`to_float32`).
    """
    match space:
        case DictSpace():
            parts = [
                flatten(each, _entry(value, key, where), f"{where}[{key!r}]", batch)
                for key, each in sorted(space.spaces.items())
            ]
            return _joined(parts, batch)
        case TupleSpace():
            n_parts = len(value) if isinstance(value, Sequence | np.ndarray) else 0
            if n_parts != len(space.spaces):
                raise SchemaError(f"{where} has {n_parts} parts, expected {len(space.spaces)}")
            pairs = enumerate(zip(space.spaces, value, strict=True))
            parts = [flatten(each, v, f"{where}[{k}]", batch) for k, (each, v) in pairs]
            return _joined(parts, batch)
    array = np.asarray(value)
    shape = (*batch, width(space))
    if array.size != math.prod(shape) or array.shape[: len(batch)] != batch:
        raise SchemaError(
            f"{where} has shape {array.shape}, expected {width(space)} numbers"
            f"{f' in each of {batch[0]} rows' if batch else ''} ({space})"
        )
    return to_float32(array, where).reshape(shape)


def unflatten(space: Space, rows: NDArray[Any]) -> Any:
    """Returns the value of a row from `flatten`, maybe padded, in the environment's dtypes.

    Of rows [n, columns], its arrays begin with an axis of n.
    """
    batch = rows.shape[:-1]
    match space:
        case DictSpace() | TupleSpace():
            ends = accumulate(map(width, parts_of(space)))
            pairs = zip(parts_of(space), ends, strict=True)
            values = [unflatten(s, rows[..., end - width(s) : end]) for s, end in pairs]
            if isinstance(space, TupleSpace):
                return tuple(values)
            return dict(zip(sorted(space.spaces), values, strict=True))
        case BoxSpace():
            return rows[..., : width(space)].astype(space.dtype).reshape((*batch, *space.shape))
        case DiscreteSpace():
            return rows[..., 0].astype(np.int64) if batch else int(rows[0])
        case MultiDiscreteSpace():
            return rows[..., : width(space)].astype(np.int64)
    return rows[..., : width(space)].astype(np.int8)


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
    pairs = [bounds(part) for part in parts_of(space)]
    lows, highs = zip(*pairs, strict=True) if pairs else ((), ())
    empty = np.zeros(0)
    return np.concatenate([empty, *lows]), np.concatenate([empty, *highs])


def column_names(space: Space, name: str = "") -> list[str]:
    """Names of the columns of a space called `name`: `pose.0` to `pose.3`, `goal_known`."""
    match space:
        case DictSpace():
            parts = {key: space.spaces[key] for key in sorted(space.spaces)}
        case TupleSpace():
            parts = {str(k): part for k, part in enumerate(space.spaces)}
        case _ if width(space) == 1 and name:
            return [name]
        case _:
            return [f"{name}.{k}".removeprefix(".") for k in range(width(space))]
    named = ((f"{name}.{key}".removeprefix("."), part) for key, part in parts.items())
    return [column for each, part in named for column in column_names(part, each)]


class Limits(NamedTuple):
    """What the numbers of several agents may be, [N, most columns]; padding is 0."""

    lows: Float
    highs: Float
    whole: NDArray[np.bool_]  # columns of choices and bits, which are whole numbers

    def outside(self, rows: Float) -> NDArray[np.bool_]:
        """Which numbers are not in their space, of rows [..., N, most columns]."""
        wrong: NDArray[np.bool_] = (rows < self.lows) | (rows > self.highs)
        return wrong | (self.whole & (rows != np.round(rows)))

    def check(self, rows: Float, acting: NDArray[np.bool_], names: Sequence[Any]) -> None:
        """Checks actions [..., N, most columns] of N agents, of whom some act, [..., N].

        Raises:
            SchemaError: an action is not in its space.
        """
        wrong = self.outside(rows) & acting[..., None]
        if wrong.any():
            place = tuple(int(k) for k in np.argwhere(wrong)[0])
            *step, agent, column = place
            raise SchemaError(
                f"action of {names[agent]} is {rows[place]:g} in column {column}"
                f"{f' of step {step[0]}' if step else ''}, expected {self.described(agent, column)}"
                ", as its space says. Clip or round it before the step."
            )

    def described(self, agent: int, column: int) -> str:
        """What a number may be, in words."""
        kind = "a whole number" if self.whole[agent, column] else "a value"
        return f"{kind} from {self.lows[agent, column]:g} to {self.highs[agent, column]:g}"


def limits_of(spaces: Sequence[Space]) -> Limits:
    """The limits of the spaces of N agents."""
    columns = [(*bounds(space), _whole(space)) for space in spaces]
    with np.errstate(over="ignore"):  # a bound beyond float32 is none
        lows, highs, whole = (stack_agents(list(each)) for each in zip(*columns, strict=True))
    return Limits(lows, highs, whole != 0)


def _whole(space: Space) -> NDArray[np.bool_]:
    """Which columns are of choices or bits, [width(space)]."""
    if isinstance(space, DictSpace | TupleSpace):
        return np.concatenate([np.zeros(0, np.bool_), *map(_whole, parts_of(space))])
    return np.full(width(space), not isinstance(space, BoxSpace))


def _filled(bound: Bound, infinite: float, space: BoxSpace) -> Double:
    values = bound if isinstance(bound, tuple) else (bound,)
    numbers = np.array([infinite if v is None else v for v in values], dtype=np.float64)
    return np.broadcast_to(numbers, (width(space),)).copy()


def parts_of(space: "DictSpace | TupleSpace") -> tuple[Space, ...]:
    """The spaces inside, in the order of their columns."""
    if isinstance(space, TupleSpace):
        return space.spaces
    return tuple(space.spaces[key] for key in sorted(space.spaces))


def _entry(value: Mapping[str, Any], key: str, where: str) -> Any:
    if not isinstance(value, Mapping) or key not in value:
        raise SchemaError(f"{where} has no entry {key!r}, expected a mapping with it: {value!r}")
    return value[key]


def _joined(parts: list[NDArray[np.float32]], batch: tuple[int, ...]) -> Float:
    return np.concatenate([np.zeros((*batch, 0), np.float32), *parts], axis=-1)


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


_KINDS = ("Box", "Discrete", "MultiDiscrete", "MultiBinary", "Dict", "Tuple")


def space_of(space: Any, where: str) -> Space:
    """Describes a space of gymnasium or of the older gym, which VMAS uses, by the class names.

    Errors call it `where`, such as "action space of agent_0".

    Raises:
        SpecError: values of such a space cannot be stored as rows of numbers.
    """
    names = [kind.__name__ for kind in type(space).__mro__]
    match next((name for name in names if name in _KINDS), None):
        case "Box":
            low, high = common_bound(space.low), common_bound(space.high)
            return BoxSpace(shape=tuple(space.shape), dtype=str(space.dtype), low=low, high=high)
        case "Discrete":
            return DiscreteSpace(n=int(space.n), start=int(getattr(space, "start", 0)))
        case "MultiDiscrete":
            if np.any(getattr(space, "start", 0)):
                raise SpecError(f"{where} is {space}: a MultiDiscrete must start at 0 to be stored")
            return MultiDiscreteSpace(n=tuple(int(n) for n in np.ravel(space.nvec)))
        case "MultiBinary":
            return MultiBinarySpace(n=math.prod(space.shape or ()))
        case "Dict":
            parts = {str(k): space_of(s, f"{where}[{k!r}]") for k, s in space.spaces.items()}
            return DictSpace(spaces=parts)
        case "Tuple":
            inner = enumerate(space.spaces)
            return TupleSpace(spaces=tuple(space_of(s, f"{where}[{k}]") for k, s in inner))
    raise SpecError(
        f"{where} is {space}, expected Box, Discrete, MultiDiscrete, MultiBinary, Dict or Tuple: "
        "only values of a fixed number of numbers can be stored. Wrap the environment so that it "
        "has one of these."
    )


def common_bound(values: NDArray[Any]) -> Bound:
    """One number if all are equal; None is infinite."""
    each = [float(v) if np.isfinite(v) else None for v in np.ravel(values).tolist()]
    if len(set(each)) <= 1:
        return each[0] if each else None
    return tuple(each)


def to_gymnasium(space: Space) -> Any:
    """Builds the `gymnasium.spaces.Space` of this description."""
    from gymnasium import spaces  # noqa: PLC0415  (only who converts needs it)

    match space:
        case BoxSpace():
            low, high = (each.astype(space.dtype).reshape(space.shape) for each in bounds(space))
            return spaces.Box(low, high, dtype=np.dtype(space.dtype).type)
        case DiscreteSpace():
            return spaces.Discrete(space.n, start=space.start)
        case MultiDiscreteSpace():
            return spaces.MultiDiscrete(space.n)
        case MultiBinarySpace():
            return spaces.MultiBinary(space.n)
        case DictSpace():
            return spaces.Dict({key: to_gymnasium(each) for key, each in space.spaces.items()})
    return spaces.Tuple([to_gymnasium(each) for each in space.spaces])
