"""Losses of in-sample methods: hand-computed values, what minimizes them, and their gradients."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.objectives.in_sample import (  # noqa: E402
    expectile_loss,
    exponential_weights,
    soft_value_loss,
    weighted_cloning_loss,
)


def best(loss: object, low: float = -5.0, high: float = 5.0) -> float:
    """The v that minimizes loss(v), to 0.002."""
    values = torch.linspace(low, high, 5001, dtype=torch.float64)
    return float(values[int(loss(values).argmin())])  # type: ignore[operator]


def test_the_expectile_loss_by_hand() -> None:
    loss = expectile_loss(torch.tensor([2.0, -2.0, 0.0]), 0.7)
    torch.testing.assert_close(loss, torch.tensor([0.7 * 4, 0.3 * 4, 0.0]))


@settings(deadline=None, max_examples=30)
@given(
    q=st.lists(st.floats(-4, 4), min_size=2, max_size=6),
    low=st.floats(0.5, 0.95),
)
def test_expectiles_rise_from_the_mean_to_the_maximum(q: list[float], low: float) -> None:
    qs = torch.tensor(q, dtype=torch.float64)

    def found(expectile: float) -> float:
        return best(lambda v: expectile_loss(qs[:, None] - v, expectile).mean(0))

    assert found(0.5) == pytest.approx(np.mean(q), abs=0.01)
    assert found(low) >= found(0.5) - 0.01
    assert found(0.999) <= max(q) + 0.01
    assert found(0.999) >= found(low) - 0.01


def test_weights_by_hand_are_clipped_and_carry_no_gradient() -> None:
    z = torch.tensor([0.0, math.log(3), 50.0, -math.inf], requires_grad=True)
    weights = exponential_weights(z, 100.0)
    torch.testing.assert_close(weights, torch.tensor([1.0, 3.0, 100.0, 0.0]))
    assert not weights.requires_grad


def test_weighted_cloning_by_hand() -> None:
    pi = torch.zeros(1, 2, 2, 2)  # [K, B, N, A]
    actions = torch.tensor([[[[1.0, 1.0], [0.0, 2.0]], [[0.0, 0.0], [1.0, 0.0]]]])
    each = torch.tensor([[[1.0, 10.0], [5.0, 2.0]]])
    loss = weighted_cloning_loss(pi, actions, each)
    torch.testing.assert_close(loss, torch.tensor([(1 * 1 + 10 * 2 + 0 + 2 * 0.5) / 4]))
    whole = weighted_cloning_loss(pi, actions, torch.tensor([[[3.0], [1.0]]]))
    torch.testing.assert_close(whole, torch.tensor([(3 * 1 + 3 * 2 + 0 + 1 * 0.5) / 4]))
    one = weighted_cloning_loss(pi, actions, torch.ones(1, 2, 1))
    torch.testing.assert_close(one[0], (pi - actions).square().mean())


@settings(deadline=None, max_examples=30)
@given(q=st.lists(st.floats(-2, 2), min_size=1, max_size=6))
def test_the_soft_value_is_the_log_mean_exp(q: list[float]) -> None:
    """The loss of OMIGA's V is least where the mean of exp(q - v) is 1."""
    qs = torch.tensor(q, dtype=torch.float64)
    found = best(lambda v: soft_value_loss(qs[:, None] - v, v.expand(len(q), -1), 1e4).mean(0))
    assert found == pytest.approx(math.log(np.mean(np.exp(q))), abs=0.01)
    assert np.mean(q) - 0.01 <= found <= max(q) + 0.01


def soft_slope(q: float, v: float, largest: float) -> tuple[float, float]:
    """The soft value loss of one q and v, and its slope in v."""
    value = torch.tensor(v, dtype=torch.float64, requires_grad=True)
    loss: Tensor = soft_value_loss(q - value, value, largest)
    (slope,) = torch.autograd.grad(loss, value)
    return loss.item(), slope.item()


def test_the_soft_value_loss_by_hand() -> None:
    assert soft_slope(1.0, 0.5, 100.0) == pytest.approx((math.exp(0.5) + 0.5, 1 - math.exp(0.5)))
    # beyond the limit: the tangent at log(10), 10 + 10 (z - log 10)
    z = math.log(10) + 2
    assert soft_slope(z, 0.0, 10.0) == pytest.approx((10 + 10 * 2, 1 - 10))


def test_a_value_far_too_low_is_raised_and_never_lowered() -> None:
    """Cutting z would leave a slope of + 1, and the value would fall without an end."""
    for gap in (6.0, 20.0, 500.0):
        loss, slope = soft_slope(gap, 0.0, 100.0)
        assert slope == pytest.approx(1 - 100)
        assert math.isfinite(loss)
