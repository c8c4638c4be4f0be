"""MADDPG+CQL: where its joint actions are sampled."""

import math

import torch

from swarmdata.offline_algos.maddpg_cql import MADDPGCQL
from tests.offline_algos.toys import made, random_batch


def test_samples_are_from_anywhere_and_near_both_policies() -> None:
    algorithm, batch = made(MADDPGCQL, 2, n_samples=7, sample_noise=1e-3), random_batch(2)
    samples = algorithm.samples(batch)
    anywhere, now, later = samples.actions.split(7, 2)  # type: ignore[no-untyped-call]
    actor = algorithm.actor
    for near, observations in ((now, batch.observations), (later, batch.next_observations)):
        centers = actor(observations)[:, :, None].expand_as(near)
        torch.testing.assert_close(near, centers, rtol=0, atol=0.01)
    assert not torch.allclose(now, later, atol=0.02)
    assert anywhere.std() > 0.5
    even, peaked, _ = samples.log_density.split(7, 2)  # type: ignore[no-untyped-call]
    assert torch.equal(even, torch.full_like(even, -4 * math.log(2.0)))
    assert peaked.min() > even.max()  # close to the policy, where few uniform samples fall
    assert not samples.actions.requires_grad
