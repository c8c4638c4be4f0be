"""Taking the smallest numbers in turn is a stable sort."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from swarmdata.perception.sensing.state import order_keys, take_smallest
from swarmdata.types import Double, Int

numbers = st.floats(allow_nan=False).map(lambda x: x + 0.0)  # -0 becomes 0


@njit  # type: ignore[untyped-decorator]
def ranks(values: Double) -> Int:
    """Indices of the values, smallest first, by the functions under test."""
    keys = values.copy().view(np.int64)
    order_keys(keys)
    out = np.empty(values.shape[0], np.int64)
    for k in range(values.shape[0]):
        out[k] = take_smallest(keys)
    return out


@pytest.mark.slow
@given(st.lists(numbers, max_size=70))
def test_numbers_come_out_in_order(values: list[float]) -> None:
    array = np.array(values, dtype=np.float64)
    np.testing.assert_array_equal(ranks(array), np.argsort(array, kind="stable"))


@pytest.mark.slow
@given(st.lists(st.sampled_from([-np.inf, -1.5, 0.0, 5e-324, 2.0, np.inf]), max_size=40))
def test_the_first_of_equal_numbers_comes_first(values: list[float]) -> None:
    array = np.array(values, dtype=np.float64)
    np.testing.assert_array_equal(ranks(array), np.argsort(array, kind="stable"))
