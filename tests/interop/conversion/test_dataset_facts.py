"""Rows to values of spaces and back."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.interop.conversion.dataset_facts import split_rows
from swarmdata.specs.spaces import (
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    flatten,
    to_gymnasium,
    unflatten,
    width,
)

Counts = st.integers(1, 4)
Leaves: st.SearchStrategy[Space] = st.one_of(
    st.builds(
        BoxSpace,
        shape=st.lists(st.integers(1, 3), max_size=2).map(tuple),
        dtype=st.sampled_from(["float32", "float64"]),
        low=st.sampled_from([None, -1.0]),
        high=st.sampled_from([None, 2.0]),
    ),
    st.builds(DiscreteSpace, n=Counts, start=st.integers(-2, 2)),
    st.builds(MultiDiscreteSpace, n=st.lists(Counts, min_size=1, max_size=3).map(tuple)),
    st.builds(MultiBinarySpace, n=Counts),
)
Spaces: st.SearchStrategy[Space] = st.recursive(
    Leaves,
    lambda inner: st.one_of(
        st.builds(DictSpace, spaces=st.dictionaries(st.sampled_from("bac"), inner, min_size=1)),
        st.builds(TupleSpace, spaces=st.lists(inner, min_size=1, max_size=3).map(tuple)),
    ),
    max_leaves=3,
)


def sample(space: Space, n: int, seed: int) -> np.ndarray[Any, Any]:
    """Rows of values that Gymnasium drew, with a column of padding."""
    theirs = to_gymnasium(space)
    theirs.seed(seed)
    rows = [flatten(space, theirs.sample(), "sample") for _ in range(n)]
    return np.concatenate([np.stack(rows), np.zeros((n, 1), np.float32)], 1)


@given(space=Spaces, n=st.integers(1, 4), seed=st.integers(0, 9))
def test_rows_survive(space: Space, n: int, seed: int) -> None:
    rows = sample(space, n, seed)
    values = split_rows(space, rows)
    np.testing.assert_array_equal(flatten(space, values, "x", (n,)), rows[:, : width(space)])


@given(space=Spaces, seed=st.integers(0, 9))
def test_each_row_is_what_unflatten_gives(space: Space, seed: int) -> None:
    rows = sample(space, 3, seed)
    values = split_rows(space, rows)

    def at(value: Any, k: int) -> Any:
        if isinstance(value, dict):
            return {key: at(each, k) for key, each in value.items()}
        return tuple(at(e, k) for e in value) if isinstance(value, tuple) else value[k]

    for k, row in enumerate(rows):
        np.testing.assert_equal(at(values, k), unflatten(space, row))


def test_what_does_not_fit_is_refused() -> None:
    box = BoxSpace(shape=(2,), dtype="float32")
    with pytest.raises(SchemaError, match=r"x has shape \(3, 3\), expected 2 numbers in each of 3"):
        flatten(box, np.zeros((3, 3)), "x", (3,))
    with pytest.raises(SchemaError, match="expected a mapping"):
        flatten(DictSpace(spaces={"a": box}), np.zeros((3, 2)), "x", (3,))
    with pytest.raises(SchemaError, match=r"above 16777216.*: 33554432 at \[1\], expected smaller"):
        flatten(DiscreteSpace(n=5), np.array([1, 1 << 25]), "x", (2,))
