"""Cloning given a latent of the episode: whose latent is learned, and conventions that are kept."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.setup import Setup
from swarmdata.offline_algos.bc_latent import BCLatent, BCLatentConfig
from swarmdata.types import Step
from tests.offline_algos.toys import SIZES, random_batch, same_side, statistics, step_of, trained

N_EPISODES = 6


def made() -> BCLatent:
    setup = Setup(SIZES, (0, 1), statistics(), n_episodes=N_EPISODES)
    return BCLatent(setup, BCLatentConfig(hidden=(8,)))


def test_the_loss_is_of_the_episodes_own_latent() -> None:
    algorithm = made()
    batch = replace(random_batch(2), episodes=torch.randint(N_EPISODES, (2, 32)))
    w = torch.stack([algorithm.latents()[k][batch.episodes[k]] for k in range(2)])
    expected = (algorithm._act(batch.observations, w) - batch.actions).square().mean((1, 2, 3))
    losses = algorithm.update(batch)
    torch.testing.assert_close(losses["bc_loss"], expected.detach())
    torch.testing.assert_close(losses["latent_size"], w.detach().square().mean((1, 2)))


def test_only_episodes_in_the_batch_learn_of_it() -> None:
    algorithm = made()
    (before,) = algorithm.table._frozen
    kept = before.weight.clone()
    algorithm.update(replace(random_batch(2), episodes=torch.full((2, 32), 3)))
    changed = (before.weight != kept).any(2)  # [K, M]
    assert changed[:, 3].all()
    assert changed.sum() == 2


def test_episodes_must_be_known() -> None:
    with pytest.raises(SchemaError, match="expected their number"):
        BCLatent(Setup(SIZES, (0,), statistics()), BCLatentConfig())
    with pytest.raises(SchemaError, match="without `episodes`"):
        made().update(random_batch(2))


def test_a_policy_takes_a_recorded_latent_for_the_whole_episode() -> None:
    algorithm = made()
    algorithm.update(replace(random_batch(2), episodes=torch.randint(N_EPISODES, (2, 32))))
    policy, step = algorithm.policy(1), step_of(copies=400)
    drawn = policy.draw(step)
    rows = (drawn[:, None] == algorithm.latents()[1].double()).all(2)  # [E, M]
    assert (rows.sum(1) == 1).all()
    counts = rows.sum(0)
    assert counts.min() > 0.5 * 400 / N_EPISODES  # all of them, about as often
    assert torch.equal(policy.draw(step_of(copies=400, times=9)), drawn)

    actions = policy.act(step)
    observations = torch.from_numpy(step.observations)
    expected = algorithm._act(observations.expand(2, -1, -1, -1), drawn.float().expand(2, -1, -1))
    np.testing.assert_allclose(actions, expected[1].detach().numpy(), atol=1e-6)
    assert not policy.log_probs(Step._make(step), actions).any()
    assert np.isneginf(policy.log_probs(step, actions * np.float32(0.5))).all()


@pytest.mark.learns
def test_a_team_keeps_one_convention_and_each_as_often_as_the_data() -> None:
    """Two conventions, which nothing observed tells; `bc` stays between them (`test_bc_flow`)."""
    algorithm, _ = trained(BCLatent, same_side(), 800)
    for seed in range(2):
        policy = algorithm.policy(seed)
        side = np.stack([policy.act(step_of(300, times=t))[..., 1] for t in (0, 5)])
        assert (np.abs(np.abs(side) - 0.8) < 0.2).mean() > 0.95
        assert (np.sign(side) == np.sign(side[0, :, :1])).all(axis=(0, 2)).mean() > 0.95
        assert 0.35 < (side[0] > 0).mean() < 0.65
