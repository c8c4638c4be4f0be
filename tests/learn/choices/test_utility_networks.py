"""VDN and QMIX offline: targets, both networks, masks in the target and when acting, losses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.choices import bins
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.offline_algos.qmix import QMIX, QMIXConfig
from swarmdata.offline_algos.vdn import VDN, VDNConfig
from tests.offline_algos.toys import SIZES, actions_of, random_batch, statistics, two_episodes

DISCRETE = replace(SIZES, choices=((range(3), range(3)), (range(1, 3),)))


def made(
    n_seeds: int = 1,
    *,
    sizes: Sizes = SIZES,
    is_monotonic: bool = False,
    return_std: float = 1.0,
    **config: Any,
) -> VDN | QMIX:
    moments = statistics(return_std=return_std, max_return=1.0)
    small = {"hidden": (8,), "n_bins": 3, "regulariser": "none", "clip_target": False, **config}
    if is_monotonic:
        mixing = QMIXConfig(**small, mixer_embedding=4, mixer_hidden=4)
        return QMIX(Setup(sizes, range(n_seeds), moments), mixing)
    return VDN(Setup(sizes, range(n_seeds), moments), VDNConfig(**small))


def make_constant(network: StackedMLP, *outputs: list[float]) -> None:
    """Makes every network of a stack answer the same to everything; one row of outputs each."""
    network.flat.zero_()
    with torch.no_grad():
        network.layers[-1].bias.copy_(torch.tensor(outputs)[:, None])


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    learner = made(discount=0.5, return_std=2.0)

    def value(utilities: Tensor, choices: Tensor, states: Tensor, alive: Any, mixer: Any) -> Tensor:
        v = 100 * states[..., 0] + 10 * states[..., 1]
        return torch.stack([v - 1, v + 1], 1)  # the mean of both networks counts

    monkeypatch.setattr(learner, "value", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = learner.targets(learner.networks.see(batch))
    # episode 1: half of 2, and V(1, 1) / 2, then 3 without a bootstrap; a cut does not stop it
    torch.testing.assert_close(y, torch.tensor([[1 + 55.0, 3.0, 1 + 105.0, 3 + 110.0]]))


@pytest.mark.parametrize("is_monotonic", [False, True])
def test_the_online_networks_choose_and_the_targets_value(is_monotonic: bool) -> None:
    learner, batch = made(2, is_monotonic=is_monotonic, discount=0.5), random_batch(2)
    for seed, network in enumerate(learner.networks.descent.targets.values()):
        network.flat.normal_(generator=torch.Generator().manual_seed(seed))
    networks, features = learner.networks, batch.next_observations  # moments are 0 and 1
    online = networks.utilities(features).mean(1)
    target = networks.utilities(features, learner.networks.descent.targets["team"])
    best = online.argmax(-1)
    assert (target.mean(1).argmax(-1) != best).any()
    taken = torch.stack([bins.chosen(target[:, each], best) for each in range(2)], 1)
    if isinstance(learner, QMIX):
        slow = learner.networks.descent.targets["mixer"]
        x_next = networks.information(batch.next_states, features)
        q_next = learner.mix(taken, x_next, slow).mean(1)
    else:
        q_next = taken.mean((1, 3))
    expected = batch.rewards.mean(-1) + 0.5 * ~batch.terminations * q_next
    torch.testing.assert_close(learner.targets(learner.networks.see(batch)), expected.detach())


def test_targets_are_at_most_what_data_return() -> None:
    batch = random_batch()
    clipped, free = made(return_std=0.5, clip_target=True), made(return_std=0.5)
    for values in (clipped, free):
        values.networks.descent.targets["team"].flat.fill_(3.0)
    r = batch.rewards.mean(-1) / 0.5
    bound = r + 0.95 * (~batch.terminations) * 2.0  # the largest return-to-go is 1
    torch.testing.assert_close(clipped.targets(clipped.networks.see(batch)), bound)
    assert (free.targets(free.networks.see(batch)) > bound + 1).any()


@pytest.mark.parametrize("head", ["factored", "joint"])
def test_the_mask_holds_in_the_target_and_when_acting(head: Any) -> None:
    """The data always take the first choice; the last has the highest utility.

    A mask in the target only lets the policy take what was never valued.
    """
    one = [9.0, 0.0, 0.0, *[0.0] * 6] if head == "joint" else [9.0, 0.0, 0.0] * 2
    batch, observations = random_batch(), np.zeros((4, 2, 3), np.float32)
    for regulariser, best in (("bcq", 0), ("none", 2)):
        learner = made(regulariser=regulariser, behavior_head=head, discount=0.5)
        online, slow = learner.networks.team.network, learner.networks.descent.targets["team"]
        make_constant(online, [1.0, 2.0, 7.0] * 2, [1.0, 2.0, 7.0] * 2)
        make_constant(slow, [3.0, 4.0, 5.0] * 2, [3.0, 4.0, 5.0] * 2)
        if learner.networks.behavior is not None:
            make_constant(learner.networks.behavior.network, one)
        q_next = (3.0, 4.0, 5.0)[best]
        expected = batch.rewards.mean(-1) + 0.5 * q_next * ~batch.terminations
        torch.testing.assert_close(learner.targets(learner.networks.see(batch)), expected)
        assert (actions_of(learner.policy(0), observations) == best - 1).all()  # bins -1, 0, 1


def test_bc_takes_the_mean_of_data_weighed_by_utilities() -> None:
    learner = made(regulariser="bc", temperature=1.0)
    assert learner.networks.behavior is not None
    make_constant(learner.networks.behavior.network, [0.0, 3.0, 0.0, 0.0, 0.0, 3.0])
    # p = softmax(U + log pi_b) of bins -1, 0, 1 has logits (top, 3, 0) and (top, 0, 3)
    for top in (1.0, 4.0):
        make_constant(learner.networks.team.network, *[[top, 0.0, 0.0] * 2] * 2)
        actions = actions_of(learner.policy(0), np.zeros((1, 2, 3), np.float32))
        total = np.exp([top, 3.0, 0.0]).sum()
        first, second = (1 - np.exp(top)) / total, (np.exp(3.0) - np.exp(top)) / total
        np.testing.assert_allclose(actions, [[[first, second]] * 2], rtol=1e-6)


def test_the_conservative_gap_by_hand() -> None:
    learner = made(regulariser="cql")
    make_constant(learner.networks.team.network, [0.0, 1.0, 2.0] * 2, [0.0] * 6)
    batch = replace(random_batch(), actions=torch.full((1, 32, 2, 2), 0.5))
    losses = learner.update(batch)
    first = np.log(1 + np.e + np.e**2) - 1.5  # the action lies between the bins 0 and 1
    assert losses["conservative_gap"].item() == pytest.approx(first + np.log(3), rel=1e-5)


def test_losses_show_overestimation() -> None:
    """Every tenth update also measures the value of what the policy would choose."""
    learner, batch = made(regulariser="bcq"), random_batch()
    names = [set(learner.update(batch)) for _ in range(11)]
    assert names[0] == names[10] == {"td_loss", "q", "greedy_q", "target", "behavior_loss"}
    assert names[1] == names[0] - {"greedy_q"}
    plain = made()
    losses = plain.update(batch)
    assert set(losses) == {"td_loss", "q", "greedy_q", "target"}
    assert losses["greedy_q"] > losses["q"]  # no action beats the best choice


@pytest.mark.parametrize("regulariser", ["none", "bc", "bcq", "cql"])
@pytest.mark.parametrize("is_monotonic", [False, True])
def test_robots_with_different_choices_learn_and_stay_within_them(
    regulariser: str, is_monotonic: bool
) -> None:
    learner = made(sizes=DISCRETE, regulariser=regulariser, is_monotonic=is_monotonic)
    g = torch.Generator().manual_seed(1)
    actions = torch.randint(3, (1, 32, 2, 2), generator=g).float()
    actions[:, :, 1, 0], actions[:, :, 1, 1] = 1 + actions[:, :, 1, 0].clamp(max=1), 0
    batch = replace(random_batch(), actions=actions)
    for _ in range(5):
        losses = learner.update(batch)
    assert all(loss.isfinite().all() for loss in losses.values())
    policy = learner.policy(0)
    seen = np.random.default_rng(0).normal(size=(200, 2, 3)).astype(np.float32)
    taken = actions_of(policy, seen)
    assert set(np.unique(taken[:, 0])) <= {0, 1, 2}
    assert set(np.unique(taken[:, 1, 0])) <= {1, 2}
    assert not taken[:, 1, 1].any()
