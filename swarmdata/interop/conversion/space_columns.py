"""Rows of numbers to values of a space and back, a whole episode at a time.

The layout of a row is that of `spaces.flatten`; here every leaf keeps its time axis.
"""

from collections.abc import Mapping
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.specs.origins import RecordedAgent, Spec
from swarmdata.specs.spaces import (
    LARGEST_EXACT_INTEGER,
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    width,
)
from swarmdata.types import Float


def agents_of(spec: Spec, n_columns: int) -> tuple[RecordedAgent, ...]:
    """The agents' spaces; those of our tasks are boxes of [-1, 1] actions.

    Args:
        spec: of the dataset.
        n_columns: of an observation, O.
    """
    spaces = zip(spec.observation_spaces(n_columns), spec.action_spaces, strict=True)
    return tuple(
        RecordedAgent(name=name, observation=observation, action=action)
        for name, (observation, action) in zip(spec.agent_names, spaces, strict=True)
    )


def split_rows(space: Space, rows: Float) -> Any:
    """Returns the values that rows hold, in the structure and dtypes of their space.

    Args:
        space: of the values.
        rows: [n, at least width(space)]; further columns are padding.
    """
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


def join_rows(space: Space, values: Any, where: str) -> Float:
    """Returns values as rows, float32 [n, width(space)]; the inverse of `split_rows`.

    Args:
        space: of the values.
        values: arrays [n, ...] in its structure.
        where: names them in errors.

    Raises:
        ConversionError: another structure or size, or whole numbers that float32 cannot hold.
    """
    if isinstance(space, DictSpace | TupleSpace):
        if isinstance(space, DictSpace) and not isinstance(values, Mapping):
            raise ConversionError(f"{where} is {type(values).__name__}, expected a mapping")
        parts = [join_rows(part, values[key], f"{where}[{key!r}]") for key, part in _parts(space)]
        return np.concatenate(parts, axis=1)
    array: NDArray[Any] = np.asarray(values)
    if array.ndim == 0 or array.size != len(array) * width(space) or array.dtype.kind not in "biuf":
        raise ConversionError(
            f"{where} has shape {array.shape} and dtype {array.dtype}, expected {width(space)} "
            f"numbers in each row ({space})"
        )
    if array.dtype.kind in "iu" and array.size and np.abs(array).max() > LARGEST_EXACT_INTEGER:
        raise ConversionError(f"{where} has whole numbers above {LARGEST_EXACT_INTEGER}")
    return array.reshape(len(array), -1).astype(np.float32)


def _parts(space: DictSpace | TupleSpace) -> list[tuple[Any, Space]]:
    """Keys and spaces inside, in the order of their columns."""
    if isinstance(space, TupleSpace):
        return list(enumerate(space.spaces))
    return [(key, space.spaces[key]) for key in sorted(space.spaces)]
