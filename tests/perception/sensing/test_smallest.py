"""Taking the smallest numbers in turn is a stable sort of the finite ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from swarmdata.perception.sensing.state import take_smallest
from swarmdata.types import Double, Int

numbers = st.floats(allow_nan=False) | st.sampled_from([-1.5, -0.0, 0.0, 5e-324, 2.0, np.inf])


@njit  # type: ignore[untyped-decorator]
def ranks(values: Double) -> Int:
    """Indices of the values, smallest first, by the function under test."""
    left, out = values.copy(), np.empty(values.shape[0], np.int64)
    for k in range(values.shape[0]):
        out[k] = take_smallest(left)
    return out


@given(st.lists(numbers, max_size=70))
def test_finite_numbers_come_out_in_order(values: list[float]) -> None:
    array = np.array(values, dtype=np.float64)
    order = np.argsort(array, kind="stable")
    np.testing.assert_array_equal(ranks(array), np.where(array[order] < np.inf, order, -1))
