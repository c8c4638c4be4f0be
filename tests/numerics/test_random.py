"""Random numbers: known values, uniformity, and independence of batching."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import UnknownNameError
from swarmdata.numerics.random import (
    EVALUATION_BASE,
    block_seeds,
    derive,
    mix,
    normal,
    normal_table,
    uniform,
)


def test_mix_gives_the_published_splitmix64_sequence() -> None:
    golden = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        states = np.arange(1, 4, dtype=np.uint64) * golden
    expected = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    np.testing.assert_array_equal(mix(states), np.array(expected, dtype=np.uint64))


@given(
    seed=st.integers(0, 2**64 - 1), counters=st.lists(st.integers(0, 2**63), min_size=1, max_size=5)
)
def test_derive_is_the_same_alone_and_in_a_batch(seed: int, counters: list[int]) -> None:
    batch = derive(np.uint64(seed), np.array(counters, dtype=np.uint64), 3)
    alone = [derive(np.uint64(seed), np.uint64(c), 3)[0] for c in counters]
    np.testing.assert_array_equal(batch, alone)


def test_counters_give_distinct_values_and_order_matters() -> None:
    grid = derive(5, np.arange(300, dtype=np.uint64)[:, None], np.arange(300, dtype=np.uint64))
    assert len(np.unique(grid)) == 300 * 300


def test_uniform_and_normal_have_the_right_moments() -> None:
    bits = derive(1, np.arange(200_000, dtype=np.uint64))
    u, z = uniform(bits), normal(bits)
    assert (u >= 0).all()
    assert (u < 1).all()
    assert abs(u.mean() - 0.5) < 0.003
    assert abs(u.var() - 1 / 12) < 0.001
    assert abs(z.mean()) < 0.01
    assert abs(z.std() - 1) < 0.01


def test_the_normal_table_is_exact_and_symmetric() -> None:
    table = normal_table()
    np.testing.assert_array_equal(table, -table[::-1])
    np.testing.assert_array_equal(table * 4096, np.round(table * 4096))
    assert abs(table.std() - 1) < 5e-4


def test_reserved_and_validation_seeds_are_those_of_published_results() -> None:
    """Results are published on them; seeds of datasets and of training are below 2^62."""
    assert EVALUATION_BASE == 2**62
    assert block_seeds("evaluation", 1000).tolist() == list(range(2**62, 2**62 + 1000))
    first = 2**62 + 2**32
    assert block_seeds("validation", 1000).tolist() == list(range(first, first + 1000))


@pytest.mark.parametrize("block", ["test", "valid", "reserved"])
def test_no_other_block_stands_for_one_of_the_two(block: Any) -> None:
    with pytest.raises(UnknownNameError, match="Known: evaluation, validation"):
        block_seeds(block, 1)
