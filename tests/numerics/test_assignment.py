"""The assignment is the cheapest of all permutations."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.numerics.assignment import assign, assignment_work
from swarmdata.types import Double

SQUARES = st.integers(1, 5).flatmap(
    lambda n: arrays(np.float64, (n, n), elements=st.floats(0, 10, width=32))
)


def cheapest(costs: Double) -> float:
    rows = np.arange(len(costs))
    return min(float(costs[rows, list(p)].sum()) for p in permutations(rows))


@given(costs=SQUARES)
def test_no_permutation_is_cheaper(costs: Double) -> None:
    n = len(costs)
    work, places = assignment_work(n)
    total = assign(costs, work, places)
    columns = places[0, :n]
    assert sorted(columns) == list(range(n))
    assert total == pytest.approx(float(costs[np.arange(n), columns].sum()), abs=1e-12)
    assert total == pytest.approx(cheapest(costs), abs=1e-9)


@given(costs=SQUARES)
def test_memory_of_an_earlier_call_does_not_matter(costs: Double) -> None:
    n = len(costs)
    fresh, used = assignment_work(n), assignment_work(n)
    assign(np.ones((n, n)) + np.eye(n)[::-1], *used)
    assert assign(costs, *fresh) == assign(costs, *used)
    np.testing.assert_array_equal(fresh[1][0, :n], used[1][0, :n])
