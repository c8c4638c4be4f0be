"""What a dataset holds, for converters: names, agents, rows in blocks."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.specs.origins import RecordedAgent, Spec
from swarmdata.types import (
    OPTIONAL_STATE_FIELDS,
    OPTIONAL_STEP_FIELDS,
    STATE_FIELDS,
    STEP_FIELDS,
)

STATE_ARRAYS = (*STATE_FIELDS, *OPTIONAL_STATE_FIELDS)  # arrays of an episode with T + 1 rows
STEP_ARRAYS = (*STEP_FIELDS, *OPTIONAL_STEP_FIELDS)  # arrays of an episode with T rows
TIME_ARRAYS = (*STATE_ARRAYS, *STEP_ARRAYS)  # both

NOTED_FACTS = ("seed", "policy", "end_reason", "split", "spec")
"""What the note of an export says, see `ExportNote`."""

DATASET_FACTS = (*TIME_ARRAYS, "layout", *NOTED_FACTS)
"""Everything that a dataset holds, except what is computed from it (returns, statistics)."""

NEXT_PREFIX = "next_"
"""Prefix of arrays over the states after each step, for formats with one row per step."""

Arrays = Mapping[str, NDArray[Any]]

Key = TypeVar("Key")

BLOCK_BYTES = 32 << 20  # approximate size of the part of a dataset that is in memory at a time


def array_names(dataset: Dataset) -> tuple[str, ...]:
    """Names of the arrays over time that a dataset has, without empty ones."""
    arrays = dataset.stored.arrays
    return tuple(name for name in TIME_ARRAYS if name in arrays and arrays[name].size)


def row_shapes(dataset: Dataset) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Shape of a row and dtype of each array that `step_blocks` yields, by name."""
    shapes = {}
    for name in array_names(dataset):
        array = dataset.stored.arrays[name]
        shapes[name] = (array.shape[1:], array.dtype)
        if name in STATE_ARRAYS:
            shapes[NEXT_PREFIX + name] = shapes[name]
    return shapes


def time_keys(kept: Mapping[str, Key], after: Callable[[Key], Key]) -> dict[str, Key]:
    """A format's keys of arrays over time; `after` turns that of states into that after a step."""
    keys = {name: kept[name] for name in TIME_ARRAYS if name in kept}
    following = {NEXT_PREFIX + name: after(keys[name]) for name in STATE_ARRAYS if name in keys}
    return keys | following


def step_blocks(dataset: Dataset) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
    """Yields the steps of a view, one row per step, in whole episodes of about `BLOCK_BYTES`.

    Yields:
        number of the block's first step in the view, and its arrays by name, [n, ...]; arrays over
        states come twice, before each step and (with `NEXT_PREFIX`) after it.
    """
    arrays = {name: dataset.stored.arrays[name] for name in array_names(dataset)}
    reads = MappedReads(arrays.values())
    per_step = sum(2 * each.nbytes // len(each) for each in arrays.values())
    limit = max(1, BLOCK_BYTES // max(1, per_step))
    columns: dict[str, list[NDArray[Any]]] = defaultdict(list)
    first, n_steps = 0, 0
    for number, episode in enumerate(dataset, 1):
        for name in arrays:
            values = getattr(episode, name)
            if name in STATE_ARRAYS:
                columns[NEXT_PREFIX + name].append(values[1:])
                values = values[:-1]
            columns[name].append(values)
        n_steps += len(episode)
        if n_steps >= limit or number == len(dataset):
            block = {name: np.concatenate(values) for name, values in columns.items()}
            reads.release()
            yield first, block
            columns.clear()
            first, n_steps = first + n_steps, 0


def recorded_agents(spec: Spec, n_columns: int) -> tuple[RecordedAgent, ...]:
    """The agents and their spaces, with O columns of an observation."""
    observed = spec.observation_spaces(n_columns)
    facts = zip(spec.agent_names, observed, spec.action_spaces, strict=True)
    return tuple(RecordedAgent(name=n, observation=o, action=a) for n, o, a in facts)
