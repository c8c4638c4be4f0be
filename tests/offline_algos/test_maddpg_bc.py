"""MADDPG+BC: targets, twins, the two policy gradients, and that it improves on its data."""

from dataclasses import fields, replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.training.setup import Setup  # noqa: E402
from swarmdata.offline_algos.bc import BC  # noqa: E402
from swarmdata.offline_algos.maddpg_bc import MADDPGBC  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    SIZES,
    actions_of,
    made,
    progress_of,
    random_batch,
    set_bias,
    statistics,
    trained,
    two_episodes,
)


def seen_by(algorithm: MADDPGBC, batch: Batch) -> Tensor:
    """What the critics see of a batch besides actions."""
    return algorithm.normalizer.information(batch.states, batch.observations)


def test_critics_see_state_and_every_observation() -> None:
    algorithm, batch = made(MADDPGBC), random_batch()
    x = seen_by(algorithm, batch)
    assert x.shape == (1, batch.states.shape[1], 4 + 2 * 3)
    torch.testing.assert_close(x[..., :4], batch.states)
    torch.testing.assert_close(x[..., 4:], batch.observations.flatten(2))


def noise_for(batch: Batch) -> Tensor:
    return torch.randn_like(batch.actions)


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    algorithm = made(MADDPGBC, discount=0.5)

    def value(x: Tensor, actions: Tensor) -> Tensor:
        v = 100 * x[..., :1] + 10 * x[..., 1:2]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = algorithm.targets(batch, noise_for(batch))
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    torch.testing.assert_close(y, torch.tensor([[2 + 55.0, 6.0, 2 + 105.0, 6 + 110.0]]))


def test_targets_use_the_smaller_twin_the_reward_scale_and_the_bound() -> None:
    batch = random_batch()
    team = batch.rewards.mean(-1)
    algorithm = made(MADDPGBC, changes={"return_std": 2.0, "max_return": 3.0}, discount=0.9)
    for low, bounded in ((1.0, 1.0), (2.0, 1.5)):  # R* / scale is 1.5
        set_bias(algorithm.critics.target, 0, low)
        set_bias(algorithm.critics.target, 1, 5.0)
        expected = team / 2 + 0.9 * bounded * ~batch.terminations
        torch.testing.assert_close(algorithm.targets(batch, noise_for(batch)), expected)
    free = made(MADDPGBC, changes={"max_return": 3.0}, discount=0.9, clip_target=False)
    for row in (0, 1):
        set_bias(free.critics.target, row, 8.0)
    torch.testing.assert_close(
        free.targets(batch, noise_for(batch)), team + 7.2 * ~batch.terminations
    )


def test_target_actions_are_smoothed_clipped_and_stay_in_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    algorithm = made(MADDPGBC, smoothing=1.0, smoothing_clip=0.1)
    seen: list[Tensor] = []

    def record(x: Tensor, actions: Tensor) -> Tensor:
        seen.append(actions)
        return torch.zeros(1, 2, actions.shape[1], 1)

    monkeypatch.setattr(algorithm.critics, "target_q", record)
    batch = random_batch()
    algorithm.targets(batch, noise_for(batch))
    algorithm.targets(batch, noise_for(batch))
    with torch.no_grad():
        plain = algorithm.actor(batch.next_observations)
    gaps = seen[0] - plain
    assert gaps.abs().max() == pytest.approx(0.1, abs=1e-6)
    assert not torch.equal(seen[0], seen[1])
    assert seen[0].abs().max() <= 1


def test_twin_critics_differ_and_both_learn() -> None:
    algorithm = made(MADDPGBC, 2)
    before = algorithm.critics.online.flat.clone()
    assert not torch.equal(before[0], before[1])
    algorithm.update(random_batch(2))
    assert algorithm.critics.online.gradient.norm(dim=1).min() > 0
    assert (algorithm.critics.online.flat - before).abs().amax(1).min() > 0
    assert not torch.equal(*algorithm.critics.online.gradient[:2])


@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_policy_gradient_is_that_of_the_written_loss(joint_gradient: str) -> None:
    """Against autograd, with lambda a constant; critics whose values are far from 0."""
    alpha = 2.5
    algorithm = made(MADDPGBC, joint_gradient=joint_gradient, rl_weight=alpha, max_grad_norm=None)
    with torch.no_grad():
        algorithm.critics.online.layers[-1].weight.mul_(50.0)
    batch = random_batch()
    pi = algorithm.actor(batch.observations)[0]  # [B, N, A]
    joint = pi if joint_gradient == "all" else None
    rows = []
    for agent in range(2):
        mixed = batch.actions[0].clone()
        mixed[:, agent] = pi[:, agent]
        rows.append(mixed if joint is None else joint)
    q = torch.stack([
        algorithm.critics.online(
            torch.cat([seen_by(algorithm, batch)[0], actions.flatten(1)], 1).expand(2, -1, -1)
        )[0, :, 0]
        for actions in rows
    ])  # fmt: skip
    assert q.abs().mean() > 2
    weight = alpha / q.abs().mean().item()
    loss = -weight * q.mean() + (pi - batch.actions[0]).square().sum(1).mean()
    algorithm.actor.online.network.backward(loss)
    expected = algorithm.actor.online.network.gradient.clone()
    losses = algorithm.actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    torch.testing.assert_close(
        algorithm.actor.online.network.gradient, expected, rtol=1e-4, atol=1e-6
    )
    assert losses["lambda"].item() == pytest.approx(weight, rel=1e-5)


def test_the_policy_gradient_does_not_depend_on_the_critics_scale() -> None:
    gradients = []
    for factor in (100.0, 1000.0):
        algorithm = made(MADDPGBC, max_grad_norm=None)
        head = algorithm.critics.online.layers[-1]
        with torch.no_grad():
            head.weight.mul_(factor)
            head.bias.mul_(factor)
        batch = random_batch()
        algorithm.actor_gradient(batch, seen_by(algorithm, batch), 2.5)
        gradients.append(algorithm.actor.online.network.gradient.clone())
    assert gradients[0].abs().sum() > 0
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-3, atol=1e-6)


def test_lambda_does_not_explode_where_values_cross_zero() -> None:
    algorithm, batch = made(MADDPGBC, rl_weight=2.5), random_batch()
    for row in (0, 1):
        set_bias(algorithm.critics.online, row, 1e-3)
    losses = algorithm.actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    assert losses["lambda"].item() == pytest.approx(2.5)


def test_the_actors_step_leaves_the_critics_alone() -> None:
    algorithm, batch = made(MADDPGBC), random_batch()
    algorithm.update(batch)
    parameters, gradient = (
        algorithm.critics.online.flat.clone(),
        algorithm.critics.online.gradient.clone(),
    )
    algorithm.actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    assert torch.equal(algorithm.critics.online.flat, parameters)
    assert torch.equal(algorithm.critics.online.gradient, gradient)


def test_the_policy_and_the_targets_move_every_other_update() -> None:
    algorithm, batch = made(MADDPGBC, policy_delay=2, tau=0.5), random_batch()
    actor, target = (
        network.flat.clone()
        for network in (algorithm.actor.online.network, algorithm.critics.target)
    )
    assert "bc_loss" not in algorithm.update(batch)
    assert torch.equal(algorithm.actor.online.network.flat, actor)
    assert torch.equal(algorithm.critics.target.flat, target)
    assert "bc_loss" in algorithm.update(batch)
    assert not torch.equal(algorithm.actor.online.network.flat, actor)
    halfway = (target + algorithm.critics.online.flat) / 2
    torch.testing.assert_close(algorithm.critics.target.flat, halfway)


def test_the_warmup_is_behavior_cloning() -> None:
    """Every update moves the actor, and only then does `policy_delay` count."""
    algorithm, batch = made(MADDPGBC, bc_warmup_updates=2, policy_delay=2), random_batch()
    keys = [set(algorithm.update(batch)) - {"critic_loss", "q"} for _ in range(5)]
    assert keys == [{"bc_loss"}, {"bc_loss"}, set(), {"bc_loss", "policy_q", "lambda"}, set()]


def test_gradients_of_seeds_are_clipped_apart() -> None:
    algorithm, batch = made(MADDPGBC, 2, max_grad_norm=0.01), random_batch(2)
    rewards = batch.rewards.clone()
    rewards[1] *= 1000
    algorithm.update(replace(batch, rewards=rewards))
    norms = algorithm.critics.online.gradient.view(2, -1).norm(dim=1)
    torch.testing.assert_close(norms, torch.tensor([0.01, 0.01]), rtol=1e-3, atol=0)


def test_a_seed_of_a_stack_learns_what_it_learns_alone() -> None:
    stack, batch = made(MADDPGBC, 3), random_batch(3)
    for _ in range(50):
        stack.update(batch)
    for seed in range(3):
        alone = MADDPGBC(Setup(SIZES, [seed], statistics()), stack.config)
        row = {f.name: getattr(batch, f.name)[seed : seed + 1] for f in fields(batch)}
        for _ in range(50):
            alone.update(Batch(**row))
        pairs = {
            "actor": (
                stack.actor.online.network.flat[seed],
                alone.actor.online.network.flat[0],
            ),
            "critics": (
                stack.critics.online.flat[2 * seed : 2 * seed + 2],
                alone.critics.online.flat,
            ),
        }
        for ours, theirs in pairs.values():
            torch.testing.assert_close(ours, theirs, rtol=0, atol=2e-5)


@pytest.mark.learns
@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_it_beats_behavior_cloning_on_a_mixture(
    mixture: MemoryDataset, joint_gradient: str
) -> None:
    """Half of the data drive at the goal, the other half at random."""
    seeds = range(3)
    ours, _ = trained(
        MADDPGBC,
        mixture,
        1500,
        seeds=seeds,
        batch_size=256,
        bc_warmup_updates=300,
        rl_weight=2.5,  # the paper's: half of these data are worth leaving
        joint_gradient=joint_gradient,
    )
    clone, _ = trained(BC, mixture, 1000, seeds=seeds, batch_size=256)
    observations = mixture.transitions["observations"]
    for index in seeds:
        learned, cloned = (
            progress_of(actions_of(a.policy(index), observations), observations)
            for a in (ours, clone)
        )
        assert learned > cloned + 0.03  # 0.11 ("all") or 0.09 ("own") against 0.045
        assert learned > 0.08  # driving straight at the goal gives 0.16
