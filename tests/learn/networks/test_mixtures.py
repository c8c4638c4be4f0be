"""Mixtures of one component are squared errors; of several, they keep the modes apart."""

import math

import pytest
import torch

from swarmdata.learn.memory.sequence_networks import Mixture


def of(weights: list[float], means: list[list[float]]) -> Mixture:
    outputs = torch.cat([torch.tensor(weights).log(), torch.tensor(means).atanh().flatten()])
    return Mixture.of(outputs.double(), len(weights))


def test_outputs_are_weights_and_means_of_each_component() -> None:
    mixture = of([1.0, 3.0], [[0.1, 0.2], [-0.3, 0.4]])
    torch.testing.assert_close(mixture.log_weights.exp(), torch.tensor([0.25, 0.75]).double())
    expected = torch.tensor([[0.1, 0.2], [-0.3, 0.4]]).double()
    torch.testing.assert_close(mixture.means, expected, atol=1e-6, rtol=0)


def test_one_component_is_a_squared_error() -> None:
    outputs, actions = torch.randn(5, 3), torch.rand(5, 2)
    errors = (outputs[:, 1:].tanh() - actions).square().mean(1)
    torch.testing.assert_close(Mixture.of(outputs, 1).surprise(actions, 0.3), errors)


def test_two_components_by_hand() -> None:
    mixture, deviation = of([0.25, 0.75], [[0.5, 0.0], [-0.5, 0.0]]), 0.5
    action = torch.tensor([0.5, 0.5]).double()
    density = 0.25 * math.exp(-0.25 / 0.5) + 0.75 * math.exp(-1.25 / 0.5)
    expected = -2 * 0.25 / 2 * math.log(density)
    assert mixture.surprise(action, deviation).item() == pytest.approx(expected, abs=1e-6)


def test_the_mode_is_where_the_density_is_largest_not_the_heaviest_component() -> None:
    """Two components share a mode; each of them is lighter than the third, alone at the other."""
    mixture = of([0.3, 0.3, 0.4], [[0.5, 0.5], [0.52, 0.5], [-0.5, 0.5]])
    assert mixture.mode(0.2)[0] > 0.4
    apart = of([0.3, 0.2, 0.5], [[0.5, 0.5], [0.0, -0.9], [-0.5, 0.5]])
    torch.testing.assert_close(apart.mode(0.2), apart.means[2])
