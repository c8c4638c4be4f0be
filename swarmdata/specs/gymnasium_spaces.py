"""Conversion of Gymnasium's spaces to ours, and back."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SpecError
from swarmdata.specs.spaces import (
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

_KINDS = ("Box", "Discrete", "MultiDiscrete", "MultiBinary", "Dict", "Tuple")


def space_of(space: Any, where: str) -> Space:
    """Describes a space of gymnasium or of the older gym, which VMAS uses, by the class names.

    Args:
        space: of an agent.
        where: names it in errors, such as "action space of agent_0".

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
