"""Choices among bins: values, interpolation, and the policy that takes the best."""

from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.choices import bins
from swarmdata.learn.networks.perceptrons import MLPShape
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.policies.choice_policy import BinPolicy
from swarmdata.perception.frames import Frame


def test_bins_are_even_and_symmetric() -> None:
    assert bins.bin_values(5).tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    assert bins.bin_values(2).tolist() == [-1.0, 1.0]
    with pytest.raises(SchemaError, match="got 1 bins"):
        bins.bin_values(1)


def made(parameters: Any = "shared", frame: Frame | None = None) -> BinPolicy:
    size = 4 + (0 if frame is None else 2)
    team = Team(MLPShape(size, (8,), 2 * 5), 3, [7], 0, parameters=parameters, device="cpu")
    return BinPolicy(
        layers=team.extract(0),
        observation_mean=torch.zeros(size, dtype=torch.float64),
        observation_std=torch.ones(size, dtype=torch.float64),
        n_bins=5,
        frame=frame,
        parameters=parameters,
    )


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_the_policy_takes_the_best_bins(parameters: str) -> None:
    policy = made(parameters)
    observations = np.random.default_rng(0).normal(size=(6, 3, 4)).astype(np.float32)
    actions = policy.actions(observations)
    assert actions.shape == (6, 3, 2)
    assert set(np.unique(actions)) <= set(bins.bin_values(5).tolist())
    expected = bins.to_actions(policy.choices(observations), 5)
    np.testing.assert_array_equal(actions, expected.numpy())
    np.testing.assert_array_equal(policy.actions(observations[2:3]), actions[2:3])


def test_other_observations_are_refused() -> None:
    with pytest.raises(SchemaError, match="expected 4 features of 3 agents"):
        made().actions(np.zeros((2, 3, 5), np.float32))
    with pytest.raises(SchemaError, match="expected 4 features of 3 agents"):
        made("separate").actions(np.zeros((2, 4, 4), np.float32))


def test_utilities_are_linear_between_bins() -> None:
    """At bins they are those of the bins, exactly; elsewhere as the weights of `two_hot` give."""
    generator = torch.Generator().manual_seed(0)
    utilities = torch.randn(50, 2, 5, generator=generator)
    choices = torch.randint(5, (50, 2), generator=generator)
    assert torch.equal(bins.interpolated(utilities, choices), bins.chosen(utilities, choices))
    assert torch.equal(bins.places(bins.to_actions(choices, 5), 5), choices.float())
    actions = torch.rand(50, 2, generator=generator) * 2.4 - 1.2
    expected = (utilities * bins.two_hot(actions, 5)).sum(-1).mean(-1)
    torch.testing.assert_close(bins.interpolated(utilities, bins.places(actions, 5)), expected)
