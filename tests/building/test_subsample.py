"""Choices of episodes: shares are kept, distributions match, larger choices hold smaller ones."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.building.subsample import bin_of, matched, proportional, quantile_edges, sized
from swarmdata.errors import BuildError, SchemaError
from swarmdata.store import EpisodeTable
from tests.support.episode_table import episode_table


def table_of(lengths: list[int], returns: list[float] | None = None) -> EpisodeTable:
    """Episodes whose policies and splits go round."""
    index, steps = np.arange(len(lengths)), np.array(lengths, dtype=np.int64)
    return episode_table(
        len(lengths), starts=np.cumsum(steps) - steps, lengths=steps,
        seeds=index.astype(np.uint64) * 7 + 3, split=(index % 3).astype(np.uint8),
        policy=(index % 2).astype(np.uint8),
        team_return=np.array(returns if returns is not None else index, dtype=np.float64),
    )  # fmt: skip


some_lengths = st.lists(st.integers(1, 20), min_size=1, max_size=60)


@given(lengths=some_lengths, share=st.floats(0.01, 1.0), seed=st.integers(0, 9))
def test_a_size_keeps_the_shares_of_splits_and_policies(
    lengths: list[int], share: float, seed: int
) -> None:
    table = table_of(lengths)
    wanted = max(1, int(share * sum(lengths)))
    chosen = sized(table, wanted, seed)
    assert (np.diff(chosen) > 0).all()
    steps = int(table.lengths[chosen].sum())
    assert wanted <= steps < wanted + max(lengths)
    for policy in range(2):
        for split in range(3):
            mine = (table.policy == policy) & (table.split == split)
            got = int(table.lengths[chosen][mine[chosen]].sum())
            expected = table.lengths[mine].sum() * steps / sum(lengths)
            assert abs(got - expected) <= 2 * max(lengths)


@given(lengths=some_lengths, seed=st.integers(0, 9))
def test_a_larger_choice_holds_the_smaller(lengths: list[int], seed: int) -> None:
    table = table_of(lengths)
    sizes = sorted({1, 1 + sum(lengths) // 3, sum(lengths)})
    chosen = [set(sized(table, size, seed).tolist()) for size in sizes]
    assert all(small <= large for small, large in pairwise(chosen))
    assert chosen[-1] == set(range(len(lengths)))


def test_a_choice_depends_on_seeds_not_on_places() -> None:
    table = table_of([5] * 40)
    order = np.random.default_rng(0).permutation(40)
    shuffled = table.take(order)
    ours = set(table.seeds[sized(table, 60, 1)].tolist())
    assert ours == set(shuffled.seeds[sized(shuffled, 60, 1)].tolist())
    assert ours != set(table.seeds[sized(table, 60, 2)].tolist())


@pytest.mark.parametrize("n_steps", [0, 41])
def test_impossible_sizes_are_refused(n_steps: int) -> None:
    with pytest.raises(SchemaError, match="expected 1 to 40"):
        sized(table_of([10] * 4), n_steps, 0)


def test_proportional_merges_strata_evenly() -> None:
    strata = np.array([0] * 8 + [1] * 4)
    order = proportional(np.ones(12, np.int64), strata, np.arange(12, dtype=np.uint64))
    for k in range(1, 13):
        assert abs((strata[order[:k]] == 1).sum() - k / 3) <= 1


returns = st.lists(st.floats(-10, 10).map(lambda x: round(x, 1)), min_size=1, max_size=80)


@given(target=returns, bins=st.integers(1, 8), seed=st.integers(0, 5))
def test_matched_returns_have_the_distribution_of_the_target(
    target: list[float], bins: int, seed: int
) -> None:
    """From twice the target and others beside, at least the target's number can be taken."""
    rng = np.random.default_rng(seed)
    pool = [*target, *target, *rng.uniform(-20, 20, 30).tolist()]
    table, wanted = table_of([3] * len(pool), pool), np.array(target)
    chosen = matched(table, wanted, None, bins, seed)
    assert len(chosen) >= 2 * len(target)
    got = table.team_return[chosen]
    edges = quantile_edges(wanted, bins)
    assert got.min() >= edges[0]
    assert got.max() <= edges[-1]
    n_bins = max(1, len(edges) - 1)
    counts = [np.bincount(bin_of(v, edges) + 1, minlength=n_bins + 1)[1:]
              for v in (got, wanted, table.team_return)]  # fmt: skip
    assert np.abs(counts[0] / len(got) - counts[1] / len(wanted)).max() <= n_bins / len(got)
    scarcest = (counts[2] / counts[1]).min()  # of the source, for each of the target
    assert scarcest * len(wanted) - n_bins < len(got) <= scarcest * len(wanted) + 1e-6


def test_matched_to_a_size() -> None:
    table = table_of([2] * 100)
    target = np.linspace(20, 60, 41)
    every = matched(table, target, None, 4, 0)
    some = matched(table, target, 30, 4, 0)
    assert 30 <= table.lengths[some].sum() < 32
    assert set(some.tolist()) <= set(every.tolist())
    assert abs(np.median(table.team_return[some]) - 40) < 8
    with pytest.raises(SchemaError, match="expected 1 to"):
        matched(table, target, 1000, 4, 0)


def test_returns_that_are_not_there_are_named() -> None:
    table = table_of([2] * 10, [0.0] * 9 + [10.0])
    with pytest.raises(BuildError, match=r"return from 2 to 4, but 20.0% of those"):
        matched(table, np.array([0.0, 2.0, 4.0, 10.0, 10.0]), None, 4, 0)
    with pytest.raises(SchemaError, match="expected 1 or more"):
        matched(table, np.array([]), None, 4, 0)


def test_equal_returns_are_one_bin() -> None:
    table = table_of([2] * 6, [1.0, 1.0, 1.0, 2.0, 2.0, 3.0])
    chosen = matched(table, np.array([2.0, 2.0]), None, 5, 0)
    np.testing.assert_array_equal(chosen, [3, 4])
    assert quantile_edges(np.array([2.0, 2.0]), 5).tolist() == [2.0]
    assert bin_of(np.array([1.9, 2.0, 2.1]), np.array([2.0])).tolist() == [-1, 0, -1]
