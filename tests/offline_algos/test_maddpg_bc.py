"""MADDPG+BC: targets, twins, the two policy gradients, and that it improves on its data."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.networks.robot_views import RobotView  # noqa: E402
from swarmdata.learn.objectives.in_sample import cloning_loss  # noqa: E402
from swarmdata.learn.training.setup import Setup  # noqa: E402
from swarmdata.offline_algos.bc import BC  # noqa: E402
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    SIZES,
    actions_of,
    made,
    progress_of,
    random_batch,
    seed_of,
    set_bias,
    statistics,
    trained,
    two_episodes,
)


def noise_for(batch: Batch) -> Tensor:
    return torch.randn_like(batch.actions)


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    algorithm = made(MADDPGBC, discount=0.5)

    def value(x: RobotView, actions: Tensor) -> Tensor:
        state = x.features[..., -4:]  # seen by each robot, [K, B, N, S]
        v = 100 * state[..., 0] + 10 * state[..., 1]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = algorithm.targets(batch, noise_for(batch))
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    bootstrap = torch.tensor([[55.0, 0.0, 105.0, 110.0]])[..., None]
    torch.testing.assert_close(y, batch.rewards + bootstrap)


def test_targets_use_the_smaller_twin_the_reward_scale_and_the_bound() -> None:
    batch = random_batch()
    goes_on = ~batch.terminations[..., None]
    changes = {"own_return_std": 2.0, "own_max_return": 3.0}
    algorithm = made(MADDPGBC, changes=changes, discount=0.9)
    for low, bounded in ((1.0, 1.0), (2.0, 1.5)):  # R* / scale is 1.5
        set_bias(algorithm.critics.target, 0, low)
        set_bias(algorithm.critics.target, 1, 5.0)
        expected = batch.rewards / 2 + 0.9 * bounded * goes_on
        torch.testing.assert_close(algorithm.targets(batch, noise_for(batch)), expected)
    free = made(MADDPGBC, changes={"own_max_return": 3.0}, discount=0.9, clip_target=False)
    for row in (0, 1):
        set_bias(free.critics.target, row, 8.0)
    torch.testing.assert_close(free.targets(batch, noise_for(batch)), batch.rewards + 7.2 * goes_on)


def test_the_reward_may_be_the_teams() -> None:
    batch = random_batch()
    algorithm = made(MADDPGBC, reward="team", changes={"return_std": 4.0}, discount=0.9)
    for row in (0, 1):
        set_bias(algorithm.critics.target, row, 1.0)
    team = batch.rewards.mean(-1, keepdim=True).expand_as(batch.rewards)
    expected = team / 4 + 0.9 * ~batch.terminations[..., None]
    torch.testing.assert_close(algorithm.targets(batch, noise_for(batch)), expected)


def test_target_actions_are_smoothed_clipped_and_stay_in_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    algorithm = made(MADDPGBC, smoothing=1.0, smoothing_clip=0.1)
    seen: list[Tensor] = []

    def record(x: RobotView, actions: Tensor) -> Tensor:
        seen.append(actions)
        return torch.zeros(1, 2, *actions.shape[1:3])

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


@pytest.mark.parametrize("critic", ["centralized", "decentralized"])
@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_policy_gradient_is_that_of_the_written_loss(joint_gradient: str, critic: str) -> None:
    """Against autograd, with lambda a constant; critics whose values are far from 0."""
    alpha = 2.5
    algorithm = made(
        MADDPGBC, joint_gradient=joint_gradient, critic=critic, rl_weight=alpha, max_grad_norm=None
    )
    with torch.no_grad():
        algorithm.critics.online.layers[-1].weight.mul_(50.0)
    batch = random_batch()
    x, n = algorithm.critic_inputs(batch), 2
    pi = algorithm.actor(batch.observations)  # [1, B, N, A]
    rows = []
    for robot in range(n):
        joint = pi.clone() if joint_gradient == "all" else batch.actions.clone()
        joint[:, :, robot] = pi[:, :, robot]
        rows.append(algorithm.critics.q(x, joint)[:, 0, :, robot])
    q = torch.stack(rows, -1)
    assert q.abs().mean() > 2
    weight = alpha / q.abs().mean().item()
    loss = -weight * q.mean() + (pi - batch.actions).square().mean()
    algorithm.actor.online.network.backward(loss)
    expected = algorithm.actor.online.network.gradient.clone()
    losses = algorithm.actor_gradient(batch, x, alpha)
    torch.testing.assert_close(
        algorithm.actor.online.network.gradient, expected, rtol=1e-4, atol=1e-6
    )
    assert losses["lambda"].item() == pytest.approx(weight, rel=1e-5)


@pytest.mark.parametrize("n_agents", [4, 8])
def test_the_pull_of_value_and_data_does_not_change_with_more_independent_robots(
    n_agents: int,
) -> None:
    """Both gradients at one robot's action, among one and among more others like it."""
    few = made(MADDPGBC, critic="decentralized").critics.online.extract(0, torch.float32, 2)

    def pulls(n: int) -> tuple[Tensor, Tensor]:
        config = MADDPGBCConfig(critic="decentralized", critic_hidden=(16,), actor_hidden=(16,))
        setup = Setup(replace(SIZES, n_agents=n), [0], statistics())
        critics = MADDPGBC(setup, config).critics
        weight = few[0].weight  # of observation, number, action: here it is blind to the number
        blind = torch.cat([weight[:, :3], torch.zeros(2, n, 16), weight[:, 5:]], 1)
        critics.online.load_layers(slice(0, 2), [few[0]._replace(weight=blind), *few[1:]])
        generator = torch.Generator().manual_seed(0)
        o, a = (torch.randn(1, 64, 1, k, generator=generator) for k in (3, 2))
        o, a = o.expand(-1, -1, n, -1), a.clamp(-1, 1).expand(-1, -1, n, -1)
        pi = torch.zeros(1, 64, n, 2, requires_grad=True)
        q = critics.first_q(critics.view(torch.zeros(1, 64, 4), o), pi, pi)
        lam = 2.5 / q.detach().abs().mean((1, 2)).clamp(min=1.0)
        (of_value,) = torch.autograd.grad((lam * q.mean((1, 2))).sum(), pi)
        (of_data,) = torch.autograd.grad(cloning_loss(pi, a).sum(), pi)
        return n * of_value[:, :, 0], n * of_data[:, :, 0]

    (value_2, data_2), (value_n, data_n) = pulls(2), pulls(n_agents)
    assert value_2.abs().mean() > 1e-4
    torch.testing.assert_close(value_n, value_2)
    torch.testing.assert_close(data_n, data_2)


def test_the_policy_gradient_does_not_depend_on_the_critics_scale() -> None:
    gradients = []
    for factor in (100.0, 1000.0):
        algorithm = made(MADDPGBC, max_grad_norm=None)
        head = algorithm.critics.online.layers[-1]
        with torch.no_grad():
            head.weight.mul_(factor)
            head.bias.mul_(factor)
        batch = random_batch()
        algorithm.actor_gradient(batch, algorithm.critic_inputs(batch), 2.5)
        gradients.append(algorithm.actor.online.network.gradient.clone())
    assert gradients[0].abs().sum() > 0
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-3, atol=1e-6)


def test_lambda_does_not_explode_where_values_cross_zero() -> None:
    algorithm, batch = made(MADDPGBC, rl_weight=2.5), random_batch()
    for row in (0, 1):
        set_bias(algorithm.critics.online, row, 1e-3)
    losses = algorithm.actor_gradient(batch, algorithm.critic_inputs(batch), 2.5)
    assert losses["lambda"].item() == pytest.approx(2.5)


def test_the_actors_step_leaves_the_critics_alone() -> None:
    algorithm, batch = made(MADDPGBC), random_batch()
    algorithm.update(batch)
    parameters, gradient = (
        algorithm.critics.online.flat.clone(),
        algorithm.critics.online.gradient.clone(),
    )
    algorithm.actor_gradient(batch, algorithm.critic_inputs(batch), 2.5)
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
    algorithm = made(MADDPGBC, bc_warmup_updates=2, policy_delay=2, first_rl_weight=1.0)
    batch = random_batch()
    keys = [set(algorithm.update(batch)) - {"critic_loss", "q"} for _ in range(5)]
    warm, moved = {"bc_loss", "density_loss"}, {"bc_loss", "density_loss", "policy_q", "lambda"}
    assert keys == [warm, warm, set(), moved, set()]


@pytest.mark.parametrize("is_frozen", [True, False])
def test_critics_stand_still_in_the_second_stage(is_frozen: bool) -> None:
    algorithm = made(MADDPGBC, n_updates=10, extraction_share=0.5, frozen_critics=is_frozen)
    batch = random_batch()
    for _ in range(5):
        assert "extraction_loss" not in algorithm.update(batch)
    critics, actor = (
        network.flat.clone()
        for network in (algorithm.critics.online, algorithm.actor.online.network)
    )
    for _ in range(5):
        assert "extraction_loss" in algorithm.update(batch)
    assert torch.equal(algorithm.critics.online.flat, critics) == is_frozen
    assert not torch.equal(algorithm.actor.online.network.flat, actor)


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
        row = seed_of(batch, seed)
        for _ in range(50):
            alone.update(row)
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
        extraction="joint",
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
