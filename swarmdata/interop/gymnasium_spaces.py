"""Spaces of this library as Gymnasium's, and back."""

from typing import Any

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.spaces import (
    Bound,
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    bounds,
)


def to_gymnasium(space: Space) -> Any:
    """Builds the `gymnasium.spaces.Space` that this describes."""
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


def from_gymnasium(space: Any) -> Space:
    """Describes a Gymnasium space.

    Raises:
        ConversionError: a kind of space that has no fixed size, such as text or a graph.
    """
    from gymnasium import spaces  # noqa: PLC0415  (the same)

    match space:
        case spaces.Box():
            low, high = _bound(space.low), _bound(space.high)
            return BoxSpace(shape=space.shape, dtype=str(space.dtype), low=low, high=high)
        case spaces.Discrete():
            return DiscreteSpace(n=int(space.n), start=int(space.start))
        case spaces.MultiDiscrete() if not np.any(space.start) and space.nvec.ndim == 1:
            return MultiDiscreteSpace(n=tuple(space.nvec.tolist()))
        case spaces.MultiBinary() if isinstance(space.n, int | np.integer):
            return MultiBinarySpace(n=int(space.n))
        case spaces.Dict():
            parts = {key: from_gymnasium(each) for key, each in space.spaces.items()}
            return DictSpace(spaces=parts)
        case spaces.Tuple():
            return TupleSpace(spaces=tuple(from_gymnasium(each) for each in space.spaces))
    raise ConversionError(
        f"{space} cannot be stored, expected Box, Discrete, MultiDiscrete from 0, MultiBinary of "
        "one axis, or Dict and Tuple of them"
    )


def _bound(values: Any) -> Bound:
    """One number where all are the same; None for infinite."""
    numbers = [
        float(value) if np.isfinite(value) else None for value in np.asarray(values).reshape(-1)
    ]
    if len(set(numbers)) <= 1:
        return numbers[0] if numbers else None
    return tuple(numbers)
