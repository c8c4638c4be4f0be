"""Categorical policies act by what training finds likeliest, with a memory and without."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.choices.choice_actor import ChoiceActor
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.policies.trained import policy_of
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.testing.sample_batches import (
    BATCH,
    N_AGENTS,
    N_OBSERVATION,
    sample_batch,
    sample_setup,
    sample_step,
)
from swarmdata.types import Batch

UNEQUAL = ((range(4), range(2)), (range(1, 4),), (range(4), range(2)))
"""The second robot has one column, with choices from 1 to 3."""


def made(**settings: Any) -> ChoiceActor:
    setup = sample_setup((3, 1))
    setup = replace(setup, sizes=replace(setup.sizes, choices=UNEQUAL))
    return ChoiceActor(setup, (16,), MemorySettings(**settings), policy_network="mlp")


def recorded() -> Tensor:
    """Actions [2, BATCH, N, D], of which the second robot's second column is padding."""
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 2, (2, BATCH, N_AGENTS, 2)).astype(np.float32)
    actions[:, :, 1, 0] += 1
    actions[:, :, 1, 1] = 0
    return torch.from_numpy(actions)


def best(log_probs: Tensor) -> Tensor:
    """The likeliest choices, as recorded."""
    return log_probs.argmax(-1) + torch.tensor([[0, 0], [1, 0], [0, 0]])


def test_distributions_are_over_the_choices_that_exist() -> None:
    _, log_probs = made().along(sample_batch((3, 1), 0))

    assert log_probs.shape == (2, BATCH, N_AGENTS, 2, 4)
    torch.testing.assert_close(log_probs.exp().sum(-1), torch.ones(2, BATCH, N_AGENTS, 2))
    assert (log_probs[:, :, 1, 0, 3] == -math.inf).all()
    assert (log_probs[:, :, 1, 1, 0] == 0).all(), "one choice is certain"


def test_surprise_is_the_sum_over_columns() -> None:
    actor, actions = made(), recorded()
    _, log_probs = actor.along(sample_batch((3, 1), 0))
    surprise = actor.surprise(log_probs, actions)

    first, second = actions[0, 5, 0].long()
    expected = -log_probs[0, 5, 0, 0, first] - log_probs[0, 5, 0, 1, second]
    torch.testing.assert_close(surprise[0, 5, 0], expected)
    torch.testing.assert_close(
        surprise[1, 7, 1], -log_probs[1, 7, 1, 0, int(actions[1, 7, 1, 0]) - 1]
    )


def test_critics_see_what_was_chosen() -> None:
    encoded = made().encode(recorded())

    assert encoded.shape == (2, BATCH, N_AGENTS, 8)
    assert (encoded.sum(-1) == 2).all()
    assert encoded[0, 0, 1].tolist()[int(recorded()[0, 0, 1, 0]) - 1] == 1


def test_policies_take_the_likeliest_choices() -> None:
    actor, step = made(), sample_step()
    batch = replace(
        sample_batch((3, 1), 0),
        observations=torch.from_numpy(step.observations).expand(2, -1, -1, -1),
    )
    _, log_probs = actor.along(batch)

    for seed in range(2):
        np.testing.assert_array_equal(
            policy_of(actor, seed).act(step), best(log_probs)[seed].numpy()
        )


def test_policies_with_a_memory_take_the_likeliest_choices() -> None:
    """Also in later steps, in which the memory matters."""
    length, copies = 4, 5
    actor = made(memory="gru", memory_size=8, burn_in=0, window=length)
    rng = np.random.default_rng(2)
    shape = (length, copies, N_AGENTS, N_OBSERVATION)
    observations = rng.normal(size=shape).astype(np.float32)
    windows = torch.from_numpy(observations.swapaxes(0, 1)).expand(2, -1, -1, -1, -1)
    rows = sample_batch((3, 1), 0)
    empty = {
        name: getattr(rows, name)[:, :1, None].expand(-1, copies, length, *[-1] * n_axes)
        for name, n_axes in {"states": 1, "next_states": 1, "actions": 2, "rewards": 1}.items()
    }
    mask = torch.ones(2, copies, length, dtype=torch.bool)
    batch = Batch(
        observations=windows, next_observations=windows, **empty,
        terminations=~mask, truncations=~mask, mask=mask,
    )  # fmt: skip
    _, log_probs = actor.along(batch)
    expected = best(log_probs).view(2, copies, length, N_AGENTS, 2)

    for seed in range(2):
        policy = policy_of(actor, seed)
        step = sample_step()
        policy.reset(step, np.arange(copies))
        for t in range(length):
            actions = policy.act(step._replace(observations=observations[t]))
            np.testing.assert_array_equal(actions, expected[seed, :, t].numpy())


def test_settings_that_would_be_ignored_are_refused() -> None:
    setup = sample_setup((0,))
    setup = replace(setup, sizes=replace(setup.sizes, choices=UNEQUAL))
    with pytest.raises(SchemaError, match="got policy_network deep_sets for recorded choices"):
        BC(setup, BCConfig(policy_network="deep_sets"))
    with pytest.raises(SchemaError, match="got output clip for recorded choices"):
        BC(setup, BCConfig(output="clip"))
