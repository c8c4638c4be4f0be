"""Rewards from terms: the bits of a plain loop in float64, whatever the shapes and weights."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.numerics.weighted_terms import weighted_rewards


def plain(terms: Any, weights: Any, share: float) -> Any:
    """The definition in the module's docstring, in plain Python."""
    rewards = np.zeros(terms.shape[:2], np.float32)
    for t, team in enumerate(terms.tolist()):
        own, mean = [], 0.0
        for values in team:
            total = 0.0
            for weight, value in zip(weights.tolist(), values, strict=True):
                total += weight * value
            own.append(total)
            mean += total
        mean /= len(own)
        rewards[t] = [(1.0 - share) * total + share * mean for total in own]
    return rewards


@given(
    shape=st.tuples(st.integers(0, 5), st.integers(1, 17), st.integers(1, 12)),
    share=st.floats(0, 1),
    seed=st.integers(0, 2**32),
)
def test_a_plain_loop_has_the_same_bits(
    shape: tuple[int, int, int], share: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    terms = rng.normal(size=shape).astype(np.float32)
    weights = rng.normal(size=shape[2])
    found = weighted_rewards(terms, weights, share, (0, terms.shape[1]))
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, plain(terms, weights, share))


def test_the_share_is_that_of_the_side() -> None:
    terms = np.random.default_rng(0).normal(size=(7, 5, 3)).astype(np.float32)
    weights = np.array([2.0, -0.1, 0.7])
    found = weighted_rewards(terms, weights, 0.4, (0, 3, 5))
    for agents in (slice(0, 3), slice(3, 5)):
        np.testing.assert_array_equal(found[:, agents], plain(terms[:, agents], weights, 0.4))
    assert (found != plain(terms, weights, 0.4)).any()


def test_terms_may_be_a_view() -> None:
    terms = np.arange(48, dtype=np.float32).reshape(2, 4, 6)
    weights = np.array([1.0, -0.5])
    found = weighted_rewards(terms[..., 1:3], weights, 0.25, (0, terms.shape[1]))
    np.testing.assert_array_equal(found, plain(terms[..., 1:3], weights, 0.25))
