"""Offline VDN and QMIX: their mixing, overestimation on narrow data, and what stops it."""

import pytest
import torch

from swarmdata.offline_algos.qmix import QMIX
from swarmdata.offline_algos.vdn import VDN
from tests.offline_algos.toys import actions_of, made, progress_of, random_batch, trained
from tests.support.memory_dataset import MemoryDataset


def test_without_a_mixer_the_team_is_worth_the_mean_of_its_robots(mixture: MemoryDataset) -> None:
    algorithm, losses = trained(VDN, mixture, 1, hidden=(8,))
    utilities, weights = torch.randn(2, 2, 5, 2, 2, 9), torch.rand(2, 5, 2, 2, 9)
    each = (utilities * weights[:, None]).sum(-1).mean(-1)  # [K, J, B, N]
    value = algorithm.value(utilities, weights, torch.zeros(2, 5, 8), None)
    torch.testing.assert_close(value, each.mean(-1))
    assert set(losses[0]) <= set(VDN.LOSSES)
    assert not any("mixer" in name for name in algorithm.state_dict())


def test_without_a_sum_a_robot_learns_the_value_of_its_own_reward() -> None:
    batch = random_batch(1, 64)
    batch.terminations[...] = True
    targets = {}
    for independent in (False, True):
        algorithm = made(VDN, independent=independent)
        targets[independent] = algorithm.targets(algorithm.networks.see(batch))
    torch.testing.assert_close(targets[False], batch.rewards.mean(-1))
    torch.testing.assert_close(targets[True], batch.rewards)


def test_without_a_sum_a_value_is_bootstrapped_from_that_of_the_same_robot() -> None:
    batch = random_batch(1, 64)
    batch.terminations[...], batch.rewards[...] = False, 0.0
    algorithm = made(VDN, independent=True, parameters="separate", discount=0.5)
    values = torch.tensor([1.0, 3.0])  # of robots 0 and 1, whatever they choose
    slow = algorithm.networks.descent.targets["team"]
    with torch.no_grad():
        slow.flat[...] = 0.0
        for row, bias in enumerate(slow.layers[-1].bias):
            bias[...] = values[row % 2]
    y = algorithm.targets(algorithm.networks.see(batch))
    torch.testing.assert_close(y, (0.5 * values).expand_as(y))


def test_without_a_sum_nothing_is_learned_of_absent_robots() -> None:
    alive = torch.rand(1, 32, 2) < 0.5
    q, y = torch.randn(1, 2, 32, 2), torch.randn(1, 32, 2)
    algorithm = made(VDN, independent=True, regulariser="none")
    utilities, weights = torch.zeros(1, 2, 32, 2, 2, 9), torch.zeros(1, 32, 2, 2, 9)
    losses = [
        algorithm.loss(q, each, utilities, weights, None, alive).total
        for each in (y, torch.where(alive, y, 1e3))
    ]
    torch.testing.assert_close(*losses)


def test_states_and_observations_weigh_the_robots(mixture: MemoryDataset) -> None:
    algorithm, _ = trained(QMIX, mixture, 1, hidden=(8,))
    values, states, observations = (
        torch.randn(2, 2, 5, 2),
        torch.randn(2, 5, 8),
        torch.randn(2, 5, 8),
    )
    mixed = algorithm.mix(values, torch.cat([states, observations], 2))
    assert mixed.shape == (2, 2, 5)
    for x in ((states + 1, observations), (states, observations + 1)):
        assert not torch.allclose(algorithm.mix(values, torch.cat(x, 2)), mixed)
    assert (algorithm.mix(values + 1, torch.cat([states, observations], 2)) >= mixed).all()
    assert {"networks.mixer", "networks.target_mixer"} <= algorithm.state_dict().keys()


@pytest.mark.slow
def test_the_mixer_learns_what_only_observations_say() -> None:
    """As obstacles: rewards depend on what the robots observe, states and actions are constant."""
    batch = random_batch(1, 64)
    batch.states[...], batch.next_states[...], batch.actions[...] = 0.0, 0.0, 0.0
    batch.terminations[...] = True
    batch.rewards[...] = batch.observations[..., :1, 0].sign()
    algorithm = made(QMIX, hidden=(4,), mixer_hidden=32, learning_rate=1e-2)
    with torch.no_grad():  # the robots' own values are blind
        algorithm.networks.team.network.flat[...] = 0.0
    td_loss = [algorithm.update(batch)["td_loss"].item() for _ in range(150)]
    assert td_loss[-1] < 0.2 * td_loss[0]


@pytest.mark.learns
def test_without_a_regulariser_it_overestimates_narrow_data(good_only: MemoryDataset) -> None:
    """Good data only: what they lack is valued by guesses, which the bootstrap then spreads."""
    observations = good_only.transitions["observations"]
    value, progress = {}, {}
    for regulariser in ("none", "bc"):
        algorithm, losses = trained(QMIX, good_only, 500, regulariser=regulariser)
        value[regulariser] = losses[-1]["q"]  # 2.07 against 1.25
        policies = [algorithm.policy(seed) for seed in range(2)]
        each = [progress_of(actions_of(policy, observations), observations) for policy in policies]
        progress[regulariser] = sum(each) / 2  # 0.07 against 0.12
    assert value["none"] > value["bc"] + 0.1
    assert progress["bc"] > progress["none"] + 0.015
