"""FlowPolicy: its noise, its log-probabilities, and that it acts as training does."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
import torch

from swarmdata.learn.flows.one_step_actor import Noise, OneStepActor
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.policies.drawn_policy import FlowPolicy
from swarmdata.learn.policies.trained import flow_policy
from swarmdata.offline_algos.bc_flow import BCFlowConfig
from swarmdata.types import Step
from tests.offline_algos.toys import SIZES, random_batch, statistics, step_of


def actor_of(**settings: Any) -> OneStepActor:
    moments = replace(statistics(), observation_mean=np.array([1.0, 2.0, 3.0]))
    return OneStepActor(Setup(SIZES, (0, 1), moments), BCFlowConfig(**settings), (16,))


def made(**settings: Any) -> FlowPolicy:
    policy = flow_policy(actor_of(**settings), 0)
    assert isinstance(policy, FlowPolicy)
    return policy


@pytest.mark.parametrize("noise", get_args(Noise))
def test_a_policy_acts_as_its_actor_does(noise: Noise) -> None:
    actor, step = actor_of(noise=noise), step_of(times=7)
    policy = flow_policy(actor, 1)
    z = torch.from_numpy(policy.draw(step)).float()
    observations = torch.from_numpy(step.observations).expand(2, -1, -1, -1)
    batch = replace(random_batch(2, len(step.seeds)), observations=observations)
    expected = actor(actor.see(batch).features, z.expand(2, -1, -1, -1))[1]
    np.testing.assert_allclose(policy.act(step), expected.detach().numpy(), atol=1e-6)


@pytest.mark.parametrize(("redraw", "stays"), [("episode", True), ("step", False)])
def test_noise_is_redrawn_when_it_should_be(redraw: str, stays: bool) -> None:
    policy = made(redraw=redraw)
    early, late = policy.draw(step_of(times=0)), policy.draw(step_of(times=9))
    assert np.array_equal(early, late) == stays
    assert len(np.unique(early)) == early.size  # episodes, robots and components have their own


def test_noise_is_a_function_of_the_seed_and_has_the_given_deviation() -> None:
    step = step_of(copies=2000)
    noise = made().draw(step)
    assert noise.std() == pytest.approx(1.0, abs=0.03)
    np.testing.assert_array_equal(made(noise_scale=0.25).draw(step), 0.25 * noise)
    reversed_step = Step._make(field[::-1] for field in step)
    np.testing.assert_array_equal(made().draw(reversed_step), noise[::-1])
