"""Names of everything that a dataset holds, and its steps in blocks, for converters."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.types import (
    OPTIONAL_STATE_FIELDS,
    OPTIONAL_STEP_FIELDS,
    STATE_FIELDS,
    STEP_FIELDS,
)

STATE_ARRAYS = (*STATE_FIELDS, *OPTIONAL_STATE_FIELDS)
"""Arrays of an episode with T + 1 rows."""

STEP_ARRAYS = (*STEP_FIELDS, *OPTIONAL_STEP_FIELDS)
"""Arrays of an episode with T rows."""

TIME_ARRAYS = (*STATE_ARRAYS, *STEP_ARRAYS)
"""Both."""

EPISODE_FACTS = ("layout", "seed", "policy", "end_reason", "split")
"""One value per episode."""

DATASET_FACTS = (*TIME_ARRAYS, *EPISODE_FACTS, "spec")
"""Everything that a dataset holds, except what is computed from it (returns, statistics)."""

NEXT_PREFIX = "next_"
"""Prefix of arrays over the states after each step, for formats with one row per step."""

Arrays = Mapping[str, NDArray[Any]]

BLOCK_BYTES = 32 << 20
"""Approximate size of the part of a dataset that is in memory at a time."""


def array_names(dataset: Dataset) -> tuple[str, ...]:
    """Names of the arrays over time that a dataset has, without empty ones."""
    arrays = dataset.stored.arrays
    return tuple(
        name for name in (*STATE_ARRAYS, *STEP_ARRAYS) if name in arrays and arrays[name].size
    )


def row_shapes(dataset: Dataset) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Shape of a row and dtype of each array that `step_blocks` yields, by name."""
    shapes = {}
    for name in array_names(dataset):
        array = dataset.stored.arrays[name]
        shapes[name] = (array.shape[1:], array.dtype)
        if name in STATE_ARRAYS:
            shapes[NEXT_PREFIX + name] = shapes[name]
    return shapes


def step_blocks(dataset: Dataset) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
    """Yields the steps of a view, whole episodes at a time, one row per step.

    Yields:
        number of the block's first step in the view, and its arrays by name, [n, ...]; arrays over
        states come twice, before each step and (with `NEXT_PREFIX`) after it.
    """
    names = array_names(dataset)
    reads = MappedReads(dataset.stored.arrays[name] for name in names)
    first = 0
    for group in _groups(dataset):
        columns: dict[str, list[NDArray[Any]]] = {}
        for index in group:
            episode = dataset[index]
            for name in names:
                values = getattr(episode, name)
                if name in STATE_ARRAYS:
                    columns.setdefault(name, []).append(values[:-1])
                    columns.setdefault(NEXT_PREFIX + name, []).append(values[1:])
                else:
                    columns.setdefault(name, []).append(values)
        block = {name: np.concatenate(values) for name, values in columns.items()}
        reads.release()
        yield first, block
        first += int(sum(len(values) for values in columns["actions"]))


def _groups(dataset: Dataset) -> Iterator[Sequence[int]]:
    """Groups of consecutive episodes of about `BLOCK_BYTES`."""
    arrays, names = dataset.stored.arrays, array_names(dataset)
    per_step = sum(2 * arrays[name].nbytes // len(arrays[name]) for name in names)
    limit = max(1, BLOCK_BYTES // max(1, per_step))
    group: list[int] = []
    steps = 0
    for index, length in enumerate(dataset.episodes.lengths):
        group.append(index)
        steps += int(length)
        if steps >= limit:
            yield group
            group, steps = [], 0
    if group:
        yield group
