"""Ranking statistics against closed cases and by their properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import SchemaError
from swarmdata.evaluation.policy_selection.rank_statistics import (
    pessimistic_value,
    rank_correlation,
    ranks,
    regret,
    spearman,
)
from swarmdata.types import Double

# few distinct values, so that there are ties
values = st.integers(-4, 4).map(float)
pairs = st.integers(2, 8).flatmap(
    lambda n: st.tuples(*(arrays(np.float64, n, elements=values) for _ in range(2)))
)


def array(*numbers: float) -> Double:
    return np.array(numbers, dtype=np.float64)


def test_ties_share_their_mean_rank_and_correlation_is_pearsons_of_the_ranks() -> None:
    np.testing.assert_array_equal(ranks(array(3, 1, 3, 2)), [3.5, 1, 3.5, 2])
    np.testing.assert_array_equal(ranks(np.zeros((2, 3))), np.full((2, 3), 2.0))
    estimates, scores = array(1, 1, 2, 3), array(2, 1, 1, 5)
    expected = np.corrcoef([1.5, 1.5, 3, 4], [3, 1.5, 1.5, 4])[0, 1]
    assert spearman(estimates, scores) == pytest.approx(expected)


@pytest.mark.parametrize("estimates", [array(0.1, 0.1, 0.1), array(3, 3, 3)])
def test_a_criterion_that_tells_nothing_apart_ranks_nothing(estimates: Double) -> None:
    assert spearman(estimates, array(1, 2, 3)) == 0
    assert regret(estimates, array(1, 2, 3)) == 2  # the worst of the tied ones


@given(pairs)
def test_correlation_only_sees_the_order(pair: tuple[Double, Double]) -> None:
    estimates, scores = pair
    value = float(spearman(estimates, scores))
    assert -1 - 1e-12 <= value <= 1 + 1e-12
    assert spearman(scores, estimates) == pytest.approx(value)
    assert spearman(np.exp(estimates), 3 * scores - 7) == pytest.approx(value)
    assert spearman(-estimates, scores) == pytest.approx(-value)
    if len(set(scores)) > 1:
        assert spearman(scores, scores) == pytest.approx(1)


@given(st.lists(pairs, min_size=1, max_size=3))
def test_leading_axes_are_a_batch(batch: list[tuple[Double, Double]]) -> None:
    n = min(len(estimates) for estimates, _ in batch)
    estimates, scores = (np.stack([pair[k][:n] for pair in batch]) for k in (0, 1))
    alone = [spearman(a, b) for a, b in zip(estimates, scores, strict=True)]
    np.testing.assert_allclose(spearman(estimates, scores), alone)


def test_regret_of_a_closed_case() -> None:
    estimates, scores = array(5, 4, 3, 2), array(10, 30, 20, 40)
    assert [regret(estimates, scores, k) for k in (1, 2, 3, 4)] == [30, 10, 10, 0]


@given(pairs, st.randoms(use_true_random=False))
def test_regret_shrinks_with_more_tries_and_does_not_see_the_order_of_rows(
    pair: tuple[Double, Double], random: object
) -> None:
    estimates, scores = pair
    n = len(scores)
    found = [regret(estimates, scores, k) for k in range(1, n + 1)]
    assert found == sorted(found, reverse=True)
    assert found[0] == scores.max() - scores[estimates == estimates.max()].min(), "the worst tie"
    assert found[-1] == 0
    assert regret(scores, scores) == 0
    assert max(found) <= scores.max() - scores.min()
    order = np.arange(n)
    random.shuffle(order)  # type: ignore[attr-defined]
    assert found == [regret(estimates[order], scores[order], k) for k in range(1, n + 1)]


def test_the_correlation_of_a_few_policies_has_an_interval() -> None:
    rng = np.random.default_rng(3)
    scores = rng.normal(size=12)
    value, low, high = rank_correlation(scores + 0.3 * rng.normal(size=12), scores)
    assert 0 < low <= value <= high
    assert rank_correlation(scores, scores).high == pytest.approx(1)
    assert rank_correlation(array(1, 2), array(5, 4)).value == -1


@pytest.mark.parametrize(
    ("estimates", "scores"),
    [
        (array(1), array(1)),
        (array(1, 2), array(1, 2, 3)),
        (array(1, np.nan), array(1, 2)),
        (array(1, 2), array(np.inf, 2)),
        (np.ones((2, 2)), np.ones((2, 2))),
    ],
)
def test_what_cannot_be_ranked_is_an_error(estimates: Double, scores: Double) -> None:
    with pytest.raises(SchemaError, match="expected two finite vectors"):
        rank_correlation(estimates, scores)


def test_the_pessimistic_value_is_of_the_least_fit_and_of_its_worse_states() -> None:
    states = np.linspace(-1.0, 1.0, 101)
    fits = np.stack([states + 3.0, states + 1.0, states + 2.0])
    error = states.std() / np.sqrt(len(states))
    assert pessimistic_value(fits) == pytest.approx(1.0 - 1.96 * error, abs=0.02)
    assert pessimistic_value(fits[:1]) > pessimistic_value(fits)
    assert pessimistic_value(np.full((2, 3), 4.0)) == 4.0
