"""Rows of numbers as values of a space, for whole episodes; `spaces.flatten` is the way back."""

from itertools import accumulate
from typing import Any

import numpy as np

from swarmdata.specs.origins import RecordedAgent, Spec
from swarmdata.specs.spaces import (
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    width,
)
from swarmdata.types import Float


def recorded_agents(spec: Spec, n_columns: int) -> tuple[RecordedAgent, ...]:
    """The agents and their spaces, with O columns of an observation."""
    spaces = zip(spec.observation_spaces(n_columns), spec.action_spaces, strict=True)
    return tuple(
        RecordedAgent(name=name, observation=observation, action=action)
        for name, (observation, action) in zip(spec.agent_names, spaces, strict=True)
    )


def split_rows(space: Space, rows: Float) -> Any:
    """The values in rows [n, at least width(space)], in the structure and dtypes of their space."""
    n = len(rows)
    match space:
        case DictSpace() | TupleSpace():
            parts = _parts(space)
            ends = accumulate(width(part) for _, part in parts)
            values = {
                key: split_rows(part, rows[:, end - width(part) : end])
                for (key, part), end in zip(parts, ends, strict=True)
            }
            return values if isinstance(space, DictSpace) else tuple(values.values())
        case BoxSpace():
            return rows[:, : width(space)].astype(space.dtype).reshape(n, *space.shape)
        case DiscreteSpace():
            return rows[:, 0].astype(np.int64)
        case MultiDiscreteSpace():
            return rows[:, : width(space)].astype(np.int64)
    return rows[:, : width(space)].astype(np.int8)


def _parts(space: DictSpace | TupleSpace) -> list[tuple[Any, Space]]:
    """Keys and spaces of the entries, in the order of their columns."""
    if isinstance(space, TupleSpace):
        return list(enumerate(space.spaces))
    return [(key, space.spaces[key]) for key in sorted(space.spaces)]
