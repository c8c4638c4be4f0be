"""Spaces: rows are as wide as they say, and values come back from them."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete, Text
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, SpecError
from swarmdata.specs.spaces import (
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    bounds,
    flatten,
    space_of,
    to_gymnasium,
    unflatten,
    width,
)

leaves = st.one_of(
    st.builds(
        BoxSpace,
        shape=st.lists(st.integers(0, 3), max_size=3).map(tuple),
        dtype=st.sampled_from(["float32", "uint8", "int32"]),
        low=st.just(0.0),
        high=st.just(9.0),
    ),
    st.builds(DiscreteSpace, n=st.integers(1, 9), start=st.integers(-3, 3)),
    st.builds(MultiDiscreteSpace, n=st.lists(st.integers(1, 9), min_size=1, max_size=4).map(tuple)),
    st.builds(MultiBinarySpace, n=st.integers(1, 5)),
)
spaces = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.builds(DictSpace, spaces=st.dictionaries(st.text("abc", min_size=1), inner)),
        st.builds(TupleSpace, spaces=st.lists(inner, max_size=3).map(tuple)),
    ),
    max_leaves=5,
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


@given(spaces, st.integers(0, 99))
def test_samples_of_the_peer_come_back_exactly(space: Space, seed: int) -> None:
    peer = to_gymnasium(space)
    peer.seed(seed)
    value = peer.sample()
    row = flatten(space, value, "value")
    assert row.shape == (width(space),)
    low, high = bounds(space)
    assert ((low <= row) & (row <= high)).all()
    again = unflatten(space, np.concatenate([row, np.zeros(2, np.float32)]))  # padded
    np.testing.assert_array_equal(flatten(space, again, "value"), row)
    assert again in peer


@given(space=Spaces, seed=st.integers(0, 9))
def test_rows_of_several_values_come_back_as_each_does(space: Space, seed: int) -> None:
    peer = to_gymnasium(space)
    peer.seed(seed)
    rows = np.stack([flatten(space, peer.sample(), "sample") for _ in range(3)])
    values = unflatten(space, np.concatenate([rows, np.zeros((3, 1), np.float32)], 1))  # padded
    np.testing.assert_array_equal(flatten(space, values, "x", (3,)), rows)

    def at(value: Any, k: int) -> Any:
        if isinstance(value, dict):
            return {key: at(each, k) for key, each in value.items()}
        return tuple(at(e, k) for e in value) if isinstance(value, tuple) else value[k]

    for k, row in enumerate(rows):
        np.testing.assert_equal(at(values, k), unflatten(space, row))


def test_a_wrong_value_is_named() -> None:
    space = DictSpace(spaces={"a": BoxSpace(shape=(2,), dtype="float32")})
    with pytest.raises(SchemaError, match=r"of robot_0\['a'\] has shape \(3,\).* expected 2"):
        flatten(space, {"a": np.zeros(3)}, "observation of robot_0")
    with pytest.raises(SchemaError, match="has no entry 'a'"):
        flatten(space, {"b": np.zeros(2)}, "observation")
    with pytest.raises(SchemaError, match="is not finite"):
        flatten(space, {"a": np.array([0.0, np.nan])}, "observation")
    with pytest.raises(SchemaError, match="above 16777216"):
        flatten(DiscreteSpace(n=1 << 30), 1 << 25, "action")
    with pytest.raises(SchemaError, match="has 1 parts, expected 0"):
        flatten(TupleSpace(spaces=()), (1,), "observation")


def test_one_bound_stands_for_all_and_none_is_infinite() -> None:
    low, high = bounds(BoxSpace(shape=(2,), dtype="float32", low=-1.0, high=(None, 3.0)))
    np.testing.assert_array_equal(low, [-1, -1])
    np.testing.assert_array_equal(high, [np.inf, 3])


@given(Spaces)
def test_spaces_survive(space: Space) -> None:
    assert space_of(to_gymnasium(space), "it") == space


def test_what_has_no_fixed_size_is_refused() -> None:
    with pytest.raises(SpecError, match=r"action of a is Text.* expected Box"):
        space_of(Text(3), "action of a")
    with pytest.raises(SpecError, match="must start at 0"):
        space_of(MultiDiscrete([2, 2], start=[1, 0]), "action of a")


def test_what_does_not_fit_is_refused() -> None:
    box = BoxSpace(shape=(2,), dtype="float32")
    with pytest.raises(SchemaError, match=r"x has shape \(3, 3\), expected 2 numbers in each of 3"):
        flatten(box, np.zeros((3, 3)), "x", (3,))
    with pytest.raises(SchemaError, match="expected a mapping"):
        flatten(DictSpace(spaces={"a": box}), np.zeros((3, 2)), "x", (3,))
    with pytest.raises(SchemaError, match=r"above 16777216.*: 33554432 at \[1\], expected smaller"):
        flatten(DiscreteSpace(n=5), np.array([1, 1 << 25]), "x", (2,))
