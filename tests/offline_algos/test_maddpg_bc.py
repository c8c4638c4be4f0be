"""MADDPG+BC: targets, twins, the two policy gradients, and that it improves on its data."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.networks import StackedMLP  # noqa: E402
from swarmdata.learn.sizes import Sizes  # noqa: E402
from swarmdata.learn.statistics import Statistics  # noqa: E402
from swarmdata.offline_algos.bc import BC, BCConfig  # noqa: E402
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig  # noqa: E402
from swarmdata.testing.memory import MemoryDataset  # noqa: E402
from swarmdata.types import Batch, Episode, Float, no_messages  # noqa: E402

SIZES = Sizes(n_agents=2, observation=3, action=2, state=4)


def statistics(**changes: float) -> Statistics:
    values: dict[str, float] = {"return_std": 1.0, "max_return": 1e9, **changes}
    return Statistics(
        observation_mean=np.zeros(3),
        observation_std=np.ones(3),
        state_mean=np.zeros(4),
        state_std=np.ones(4),
        **values,
    )


def made(n_seeds: int = 1, *, changes: dict[str, float] | None = None, **config: Any) -> MADDPGBC:
    small = {"actor_hidden": (16,), "critic_hidden": (16,), "warm_start": 0, "policy_delay": 1}
    return MADDPGBC(
        SIZES,
        range(n_seeds),
        MADDPGBCConfig(**{**small, **config}),
        statistics=statistics(**(changes or {})),
    )


def random_batch(n_seeds: int = 1, size: int = 32) -> Batch:
    torch.manual_seed(0)
    flags = torch.rand(n_seeds, size) < 0.3
    return Batch(
        observations=torch.randn(n_seeds, size, 2, 3),
        actions=torch.rand(n_seeds, size, 2, 2) * 2 - 1,
        rewards=torch.randn(n_seeds, size, 2),
        next_observations=torch.randn(n_seeds, size, 2, 3),
        states=torch.randn(n_seeds, size, 4),
        next_states=torch.randn(n_seeds, size, 4),
        terminations=flags,
        truncations=~flags,
        mask=torch.ones_like(flags),
        next_actions=torch.rand(n_seeds, size, 2, 2) * 2 - 1,
    )


def set_bias(network: StackedMLP, row: int, value: float) -> None:
    """Makes one critic the constant function `value`."""
    network.flat[row] = 0.0
    bias = network.layers[-1].bias
    with torch.no_grad():
        bias[row] = value


def seen_by(algorithm: MADDPGBC, batch: Batch) -> Tensor:
    """What the critics see of a batch besides actions."""
    return algorithm.parts.information(batch.states, batch.observations)


def test_critics_see_state_and_every_observation() -> None:
    algorithm, batch = made(), random_batch()
    x = seen_by(algorithm, batch)
    assert x.shape == (1, batch.states.shape[1], 4 + 2 * 3)
    torch.testing.assert_close(x[..., :4], batch.states)
    torch.testing.assert_close(x[..., 4:], batch.observations.flatten(2))


def two_episodes() -> MemoryDataset:
    """One that terminates, one that is truncated; states tell the episode and the time."""

    def episode(number: int, *, cut: bool) -> Episode:
        steps, last = 2, np.array([False, True])
        states = np.zeros((steps + 1, 4), dtype=np.float32)
        states[:, 0], states[:, 1] = number, np.arange(steps + 1)
        return Episode(
            observations=np.zeros((steps + 1, 2, 3), dtype=np.float32),
            states=states,
            actions=np.zeros((steps, 2, 2), dtype=np.float32),
            log_probs=np.zeros((steps, 2), dtype=np.float32),
            rewards=np.array([[1.0, 3.0], [5.0, 7.0]], dtype=np.float32),  # team: 2, 6
            terminations=last & (not cut),
            truncations=last & cut,
            events=np.zeros((steps, 2, 4), dtype=np.uint8),
            **no_messages(steps + 1, 2),
            layout=np.zeros((0, 8), dtype=np.float32),
            seed=number,
            policy=0,
            end_reason=2 if cut else 0,
        )

    return MemoryDataset([episode(1, cut=False), episode(2, cut=True)])


def noise_for(batch: Batch) -> Tensor:
    return torch.randn_like(batch.actions)


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    algorithm = made(discount=0.5)

    def value(x: Tensor, actions: Tensor) -> Tensor:
        v = 100 * x[..., :1] + 10 * x[..., 1:2]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.parts.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = algorithm.targets(batch, noise_for(batch))
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    torch.testing.assert_close(y, torch.tensor([[2 + 55.0, 6.0, 2 + 105.0, 6 + 110.0]]))


def test_targets_use_the_smaller_twin_the_reward_scale_and_the_bound() -> None:
    batch = random_batch()
    team = batch.rewards.mean(-1)
    algorithm = made(changes={"return_std": 2.0, "max_return": 3.0}, discount=0.9)
    for low, bounded in ((1.0, 1.0), (2.0, 1.5)):  # R* / scale is 1.5
        set_bias(algorithm.parts.critics.target, 0, low)
        set_bias(algorithm.parts.critics.target, 1, 5.0)
        expected = team / 2 + 0.9 * bounded * ~batch.terminations
        torch.testing.assert_close(algorithm.targets(batch, noise_for(batch)), expected)
    free = made(changes={"max_return": 3.0}, discount=0.9, clip_target=False)
    for row in (0, 1):
        set_bias(free.parts.critics.target, row, 8.0)
    torch.testing.assert_close(
        free.targets(batch, noise_for(batch)), team + 7.2 * ~batch.terminations
    )


def test_target_actions_are_smoothed_clipped_and_stay_in_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    algorithm = made(noise=1.0, noise_clip=0.1)
    seen: list[Tensor] = []

    def record(x: Tensor, actions: Tensor) -> Tensor:
        seen.append(actions)
        return torch.zeros(1, 2, actions.shape[1], 1)

    monkeypatch.setattr(algorithm.parts.critics, "target_q", record)
    batch = random_batch()
    algorithm.targets(batch, noise_for(batch))
    algorithm.targets(batch, noise_for(batch))
    with torch.no_grad():
        plain = algorithm.parts.actor(batch.next_observations)
    gaps = seen[0] - plain
    assert gaps.abs().max() == pytest.approx(0.1, abs=1e-6)
    assert not torch.equal(seen[0], seen[1])
    assert seen[0].abs().max() <= 1


def test_twin_critics_differ_and_both_learn() -> None:
    algorithm = made(2)
    before = algorithm.parts.critics.online.flat.clone()
    assert not torch.equal(before[0], before[1])
    algorithm.update(random_batch(2))
    assert algorithm.parts.critics.online.gradient.norm(dim=1).min() > 0
    assert (algorithm.parts.critics.online.flat - before).abs().amax(1).min() > 0
    assert not torch.equal(*algorithm.parts.critics.online.gradient[:2])


@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_policy_gradient_is_that_of_the_written_loss(joint_gradient: str) -> None:
    """Against autograd, with lambda a constant; critics whose values are far from 0."""
    alpha = 2.5
    algorithm = made(joint_gradient=joint_gradient, alpha=alpha, max_gradient_norm=None)
    with torch.no_grad():
        algorithm.parts.critics.online.layers[-1].weight.mul_(50.0)
    batch = random_batch()
    pi = algorithm.parts.actor(batch.observations)[0]  # [B, N, A]
    joint = pi if joint_gradient == "all" else None
    rows = []
    for agent in range(2):
        mixed = batch.actions[0].clone()
        mixed[:, agent] = pi[:, agent]
        rows.append(mixed if joint is None else joint)
    q = torch.stack([
        algorithm.parts.critics.online(
            torch.cat([seen_by(algorithm, batch)[0], actions.flatten(1)], 1).expand(2, -1, -1)
        )[0, :, 0]
        for actions in rows
    ])  # fmt: skip
    assert q.abs().mean() > 2
    weight = alpha / q.abs().mean().item()
    loss = -weight * q.mean() + (pi - batch.actions[0]).square().sum(1).mean()
    algorithm.parts.actor.online.network.backward(loss)
    expected = algorithm.parts.actor.online.network.gradient.clone()
    losses = algorithm._actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    torch.testing.assert_close(
        algorithm.parts.actor.online.network.gradient, expected, rtol=1e-4, atol=1e-6
    )
    assert losses["lambda"].item() == pytest.approx(weight, rel=1e-5)


def test_the_policy_gradient_does_not_depend_on_the_critics_scale() -> None:
    gradients = []
    for factor in (100.0, 1000.0):
        algorithm = made(max_gradient_norm=None)
        head = algorithm.parts.critics.online.layers[-1]
        with torch.no_grad():
            head.weight.mul_(factor)
            head.bias.mul_(factor)
        batch = random_batch()
        algorithm._actor_gradient(batch, seen_by(algorithm, batch), 2.5)
        gradients.append(algorithm.parts.actor.online.network.gradient.clone())
    assert gradients[0].abs().sum() > 0
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-3, atol=1e-6)


def test_lambda_does_not_explode_where_values_cross_zero() -> None:
    algorithm, batch = made(alpha=2.5), random_batch()
    for row in (0, 1):
        set_bias(algorithm.parts.critics.online, row, 1e-3)
    losses = algorithm._actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    assert losses["lambda"].item() == pytest.approx(2.5)


def test_the_actors_step_leaves_the_critics_alone() -> None:
    algorithm, batch = made(), random_batch()
    algorithm.update(batch)
    parameters, gradient = (
        algorithm.parts.critics.online.flat.clone(),
        algorithm.parts.critics.online.gradient.clone(),
    )
    algorithm._actor_gradient(batch, seen_by(algorithm, batch), 2.5)
    assert torch.equal(algorithm.parts.critics.online.flat, parameters)
    assert torch.equal(algorithm.parts.critics.online.gradient, gradient)


def test_the_policy_and_the_targets_move_every_other_update() -> None:
    algorithm, batch = made(policy_delay=2, polyak=0.5), random_batch()
    actor, target = (
        network.flat.clone()
        for network in (algorithm.parts.actor.online.network, algorithm.parts.critics.target)
    )
    assert "bc_loss" not in algorithm.update(batch)
    assert torch.equal(algorithm.parts.actor.online.network.flat, actor)
    assert torch.equal(algorithm.parts.critics.target.flat, target)
    assert "bc_loss" in algorithm.update(batch)
    assert not torch.equal(algorithm.parts.actor.online.network.flat, actor)
    halfway = (target + algorithm.parts.critics.online.flat) / 2
    torch.testing.assert_close(algorithm.parts.critics.target.flat, halfway)


def test_the_warm_start_is_behavior_cloning() -> None:
    """Every update moves the actor, and only then does `policy_delay` count."""
    algorithm, batch = made(warm_start=2, policy_delay=2), random_batch()
    keys = [set(algorithm.update(batch)) - {"critic_loss", "q"} for _ in range(5)]
    assert keys == [{"bc_loss"}, {"bc_loss"}, set(), {"bc_loss", "policy_q", "lambda"}, set()]


def test_gradients_of_seeds_are_clipped_apart() -> None:
    algorithm, batch = made(2, max_gradient_norm=0.01), random_batch(2)
    rewards = batch.rewards.clone()
    rewards[1] *= 1000
    algorithm.update(replace(batch, rewards=rewards))
    norms = algorithm.parts.critics.online.gradient.view(2, -1).norm(dim=1)
    torch.testing.assert_close(norms, torch.tensor([0.01, 0.01]), rtol=1e-3, atol=0)


def test_a_seed_of_a_stack_learns_what_it_learns_alone() -> None:
    stack, batch = made(3), random_batch(3)
    for _ in range(50):
        stack.update(batch)
    for seed in range(3):
        alone = MADDPGBC(SIZES, [seed], stack.config, statistics=statistics())
        row = {f.name: getattr(batch, f.name)[seed : seed + 1] for f in fields(batch)}
        for _ in range(50):
            alone.update(Batch(**row))
        pairs = {
            "actor": (
                stack.parts.actor.online.network.flat[seed],
                alone.parts.actor.online.network.flat[0],
            ),
            "critics": (
                stack.parts.critics.online.flat[2 * seed : 2 * seed + 2],
                alone.parts.critics.online.flat,
            ),
        }
        for ours, theirs in pairs.values():
            torch.testing.assert_close(ours, theirs, rtol=0, atol=2e-5)


def progress_of(actions: Float, observations: Float) -> float:
    """Mean progress of one step at the dataset's observations; 0 for the dataset itself."""
    offsets = observations[..., 2:4]
    before = np.linalg.norm(offsets, axis=-1)
    return float((before - np.linalg.norm(offsets - 0.2 * actions, axis=-1)).mean())


@pytest.mark.learns
@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_it_beats_behavior_cloning_on_a_mixture(
    mixture: MemoryDataset, joint_gradient: str
) -> None:
    """Half of the data drive at the goal, the other half at random."""
    seeds = range(3)
    config = MADDPGBCConfig(
        n_updates=1500,
        actor_hidden=(32, 32),
        critic_hidden=(32, 32),
        warm_start=300,
        discount=0.9,
        alpha=2.5,  # the paper's: half of these data are worth leaving
        joint_gradient=joint_gradient,  # type: ignore[arg-type]
    )
    bc_config = BCConfig(n_updates=1000, hidden=(32, 32))
    measured = Statistics.measure(mixture, config.discount)
    samplers = [mixture.sampler(256, seed=seed) for seed in seeds]

    def draw() -> Batch:
        return samplers[0].gather(np.stack([s.draw() for s in samplers])).to_torch()

    sizes = Sizes.of(draw())
    ours = MADDPGBC(sizes, seeds, config, statistics=measured)
    clone = BC(sizes, seeds, bc_config, statistics=measured)
    for _ in range(config.n_updates):
        ours.update(draw())
    for _ in range(bc_config.n_updates):
        clone.update(draw())
    observations = mixture.transitions["observations"]
    for index in seeds:
        learned, cloned = (
            progress_of(a.policy(index).actions(observations), observations) for a in (ours, clone)
        )
        assert learned > cloned + 0.03  # 0.11 ("all") or 0.09 ("own") against 0.045
        assert learned > 0.08  # driving straight at the goal gives 0.16
