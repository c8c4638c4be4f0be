"""Policies of learned choices: what training chose, allowed choices, certainty."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.offline_algos.vdn import VDN, VDNConfig
from swarmdata.types import Step
from tests.offline_algos.toys import actions_of, statistics
from tests.offline_algos.toys import step_of as toy_step

SIZES = Sizes(n_agents=3, observation=3, action=2, state=4)
CHOICES = ((range(4), range(2)), (range(1, 4),), (range(4), range(2)))


def made(sizes: Sizes = SIZES, **config: Any) -> VDN:
    moments = replace(
        statistics(), observation_mean=np.full(3, 0.5), observation_std=np.full(3, 2.0)
    )
    return VDN(Setup(sizes, (3, 8), moments), VDNConfig(**{"hidden": (16,), **config}))


def step_of(n_copies: int = 40) -> Step:
    observations = np.random.default_rng(0).normal(size=(n_copies, 3, 3)).astype(np.float32)
    return toy_step(n_copies)._replace(observations=observations)


@pytest.mark.parametrize("regulariser", ["none", "bc", "bcq", "cql"])
@pytest.mark.parametrize("parameters", ["shared", "separate"])
@pytest.mark.parametrize("head", ["factored", "joint"])
@pytest.mark.parametrize("choices", [(), CHOICES])
def test_it_does_what_training_would_choose(
    regulariser: Any, parameters: Any, head: Any, choices: Any
) -> None:
    sizes = replace(SIZES, choices=choices)
    learner = made(sizes, regulariser=regulariser, parameters=parameters, behavior_head=head)
    step = step_of()
    seen = torch.from_numpy(step.observations)[None].expand(2, -1, -1, -1)
    networks = learner.networks
    features = networks.normalizer.observations(seen)
    with torch.no_grad():
        weights = networks.act(networks.utilities(features), networks.log_probs(features))
    for seed in range(2):
        policy = learner.policy(seed)
        actions = policy.act(step)
        assert not policy.log_probs(step, actions).any()
        expected = networks.choices.to_actions(weights[seed]).numpy()
        np.testing.assert_allclose(actions, expected, atol=1e-6)  # float32 of training


@pytest.mark.parametrize("regulariser", ["none", "bc", "bcq"])
def test_it_takes_the_best_of_what_is_allowed(regulariser: Any) -> None:
    policy, step = (
        made(replace(SIZES, choices=CHOICES), regulariser=regulariser).policy(0),
        step_of(),
    )
    every = np.zeros((40, 3, 6), np.bool_)
    every[:, [0, 2]], every[:, 1, :3] = True, True
    free = policy.act(step)
    np.testing.assert_array_equal(policy.act_among(step, every), free)
    masks = every.copy()  # forbid what it would do, where something is left
    masks[np.arange(40), 0, free[:, 0, 0].astype(int)] = False
    masks[np.arange(40), 1, free[:, 1, 0].astype(int) - 1] = False
    bound = policy.act_among(step, masks)
    assert (bound[:, :2, 0] != free[:, :2, 0]).all()
    assert ((bound[:, 1, 0] >= 1) & (bound[:, 1, 0] <= 3)).all()
    np.testing.assert_array_equal(bound[:, 2], free[:, 2])


def test_other_observations_are_refused() -> None:
    with pytest.raises(SchemaError, match="expected 3 features of 3 agents"):
        actions_of(made().policy(0), np.zeros((2, 3, 5), np.float32))
