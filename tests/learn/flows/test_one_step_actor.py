"""One-step actors: what a robot knows of noise, and policies that act as training does."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from swarmdata.learn.flows.one_step_actor import OneStepActor  # noqa: E402
from swarmdata.learn.policies.flow_policy import Noise  # noqa: E402
from swarmdata.learn.training.setup import Setup  # noqa: E402
from tests.offline_algos.toys import SIZES, random_batch, statistics, step_of  # noqa: E402

NOISES = get_args(Noise)


def made(noise: Noise) -> OneStepActor:
    moments = replace(statistics(), observation_mean=np.array([1.0, 2.0, 3.0]))
    return OneStepActor(Setup(SIZES, (0, 1), moments), (16,), noise=noise, redraw="step", scale=1.0)


@pytest.mark.parametrize("noise", NOISES)
def test_a_policy_acts_as_its_actor_does(noise: Noise) -> None:
    actor, step = made(noise), step_of(times=7)
    policy = actor.policy(1)
    z = torch.from_numpy(policy.draw(step)).float()
    observations = torch.from_numpy(step.observations).expand(2, -1, -1, -1)
    batch = replace(random_batch(2, len(step.seeds)), observations=observations)
    expected = actor(actor.see(batch).features, z.expand(2, -1, -1, -1))[1]
    np.testing.assert_allclose(policy.act(step), expected.detach().numpy(), atol=1e-6)


def test_the_next_step_is_seen_as_this_one() -> None:
    actor, batch = made("team"), random_batch(2)
    later = replace(batch, observations=batch.next_observations)
    assert torch.equal(actor.see_next(actor.see(batch)), actor.see(later).features)


@pytest.mark.parametrize("noise", NOISES)
def test_robots_know_others_noise_only_if_it_is_the_teams(noise: Noise) -> None:
    actor, features = made(noise), torch.zeros(2, 4, 2, 3)
    z = torch.zeros(2, 4, 2, 2)
    changed = z.clone()
    changed[:, :, 1] = 1.0  # the noise of robot 1
    moved = (actor(features, z) != actor(features, changed)).any(-1)  # [K, B, N]
    assert moved[..., 1].all()
    assert bool(moved[..., 0].any()) == (noise == "team")
