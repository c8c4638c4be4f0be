"""Cloning by flow matching: the written losses, and modes that robots choose together."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.objectives.losses import cloning_loss
from swarmdata.offline_algos.bc import BC
from swarmdata.offline_algos.bc_flow import BCFlow
from swarmdata.types import Batch, Bool, Float
from tests.offline_algos.toys import made, random_batch, same_side, step_of, trained
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset

COPIES = 300
FLOW: dict[str, Any] = {"flow_hidden": (64, 64), "noise_scale": 1.0}


def sides(actions: Float) -> Float:
    """The side that each robot goes to, -1 or 1; 0 where it stays between them, [E, N]."""
    y = actions[..., 1]
    return np.where(np.abs(y) > 0.4, np.sign(y), 0.0).astype(np.float32)


def agree(actions: Float) -> Bool:
    """Whether both robots go to the same side, [E]."""
    side = sides(actions)
    return np.asarray((side[:, 0] == side[:, 1]) & (side[:, 0] != 0))


def acted(algorithm: BCFlow, batch: Batch, z: Tensor) -> Tensor:
    actor = algorithm.copy.actor
    return actor(actor.see(batch).features, z)


def test_an_update_moves_both_and_each_by_its_own_loss() -> None:
    algorithm, batch = made(BCFlow, hidden=(8,), flow_hidden=(8,)), random_batch()
    flow, actor = algorithm.copy.flow.network, algorithm.copy.actor.network
    x = information(*algorithm.normalizer(batch.states, batch.observations))
    before = flow.flat.clone()
    z = torch.randn(1, 32, 2, 2)
    targets = algorithm.copy.targets(x, z, batch, algorithm.generators)
    algorithm.copy.step(cloning_loss(acted(algorithm, batch, z), targets), 1.0)
    assert torch.equal(flow.flat, before)  # samples have no gradient
    kept = actor.flat.clone()
    algorithm.copy.fit(x, batch, algorithm.generators, 1.0)
    assert torch.equal(actor.flat, kept)
    algorithm.update(batch)
    assert not torch.equal(flow.flat, before)
    assert not torch.equal(actor.flat, kept)


@pytest.mark.learns
def test_robots_that_share_noise_choose_the_same_side() -> None:
    """`bc` stays between the sides; robots with noise of their own agree by chance."""
    step, later, data = step_of(COPIES), step_of(COPIES, times=5), same_side()
    bc, _ = trained(BC, data, 800)
    assert agree(bc.policy(0).act(step)).mean() < 0.02

    team, _ = trained(BCFlow, data, 800, redraw="episode", **FLOW)
    own, _ = trained(BCFlow, data, 800, noise="own", **FLOW)
    for seed in range(2):
        actions = team.policy(seed).act(step)
        assert agree(actions).mean() > 0.8
        assert 0.3 < (sides(actions)[:, 0] > 0).mean() < 0.7  # both modes are there
        assert agree(own.policy(seed).act(step)).mean() < 0.5
        kept = np.sign(team.policy(seed).act(later)[..., 1]) == np.sign(actions[..., 1])
        assert kept.mean() > 0.9  # noise of an episode keeps its mode


def one_way(n_episodes: int, length: int = 16) -> MemoryDataset:
    """Four robots that do the same function of what each observes, up to little noise."""
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(6, 2)) / 2
    episodes = []
    for _ in range(n_episodes):
        observations = rng.normal(size=(length + 1, 4, 6)).astype(np.float32)
        actions = np.tanh(observations[:-1] @ weights)
        actions += rng.normal(0, 0.05, actions.shape)
        states, rewards = rng.normal(size=(length + 1, 4)), np.ones((length, 4))
        episodes.append(
            made_episode(observations, states, actions.clip(-1, 1), rewards, ends=False)
        )
    return MemoryDataset(episodes)


@pytest.mark.learns
def test_where_data_are_all_alike_it_is_as_close_to_them_as_a_clone() -> None:
    data = one_way(60)
    bc, _ = trained(BC, data, 500)
    flow, _ = trained(BCFlow, data, 500, flow_hidden=(32, 32))
    unseen = list(one_way(90))[60:]  # the first 60 are those of the training
    observations = np.concatenate([each.observations[:-1] for each in unseen])
    actions = np.concatenate([each.actions for each in unseen])
    step = step_of(len(observations))._replace(observations=observations)
    for seed in range(2):
        clone, copy = (
            np.square(each.policy(seed).act(step) - actions).mean() for each in (bc, flow)
        )
        assert copy < 1.3 * clone


@pytest.mark.learns
def test_noise_of_a_step_changes_the_side_within_an_episode() -> None:
    algorithm, _ = trained(BCFlow, same_side(), 800, redraw="step", **FLOW)
    first, later = (algorithm.policy(0).act(step_of(COPIES, times=t)) for t in (0, 5))
    assert 0.3 < (np.sign(first[..., 1]) == np.sign(later[..., 1])).mean() < 0.7
    assert agree(later).mean() > 0.8
