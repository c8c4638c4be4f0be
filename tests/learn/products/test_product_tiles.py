"""Tiles against NumPy's products: all remainders, strides and starts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.learn.products.product_tiles import DEPTH, LANES, SIZE, TALL, WIDE, multiply
from swarmdata.types import Float


def strides(values: Float) -> tuple[int, ...]:
    return tuple(step // SIZE for step in values.strides)


def multiplied(a: Float, b: Float, start: Float) -> Float:
    c = np.full((*a.shape[:2], b.shape[2]), np.nan, dtype=np.float32)
    multiply(
        (*c.shape, a.shape[2]),
        a.ctypes.data, strides(a),
        b.ctypes.data, strides(b)[:2],
        start.ctypes.data, strides(start)[0],
        c.ctypes.data,
    )  # fmt: skip
    return c


def drawn(shape: tuple[int, ...], seed: int) -> Float:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@given(
    n_matrices=st.integers(1, 3),
    n_rows=st.integers(1, 2 * TALL + 1),
    n_columns=st.integers(LANES, 2 * WIDE + 1),
    n_terms=st.sampled_from([1, 2, DEPTH - 1, DEPTH, DEPTH + 1, 2 * DEPTH + 3]),
    is_turned=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_products_equal_those_of_numpy(
    n_matrices: int, n_rows: int, n_columns: int, n_terms: int, is_turned: bool
) -> None:
    a = drawn((n_matrices, n_rows, n_terms), 0)
    if is_turned:
        a = drawn((n_matrices, n_terms, n_rows), 0).transpose(0, 2, 1)
    b, start = drawn((n_matrices, n_terms, n_columns), 1), drawn((n_matrices, n_columns), 2)
    exact = a.astype(np.float64) @ b + start[:, None]
    np.testing.assert_allclose(multiplied(a, b, start), exact, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("n_columns", [LANES, WIDE])
def test_a_row_is_the_same_alone_and_in_any_stack(n_columns: int) -> None:
    a, b = drawn((3, 4 * TALL + 1, 200), 0), drawn((3, 200, n_columns), 1)
    start = drawn((3, n_columns), 2)
    whole = multiplied(a, b, start)
    for r in range(3):
        for row in (0, TALL, 4 * TALL):
            alone = multiplied(a[r : r + 1, row : row + 1], b[r : r + 1], start[r : r + 1])
            assert (alone[0, 0] == whole[r, row]).all()
