"""MADDPG: targets and corrections, policy gradients, two episodes, and learning."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.online_algos.collection.input_moments import Moments  # noqa: E402
from swarmdata.online_algos.maddpg import MADDPG, Learner, MADDPGConfig  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import seed_of  # noqa: E402

SIZES = Sizes(n_agents=2, observation=3, action=2, state=4)
SMALL: dict[str, Any] = {
    "actor_hidden": (16,),
    "critic_hidden": (16,),
    "policy_delay": 1,
    "max_grad_norm": None,
}


def moments(seeds: Sequence[int]) -> Moments:
    """Other moments for each seed."""
    n, o, s = np.array(seeds)[:, None] / 4, np.ones((1, 3)), np.ones((1, 4))
    return Moments(n * o, n + o, n * s, n + s)


def learner_of(seeds: Sequence[int], config: MADDPGConfig) -> Learner:
    return Learner(SIZES, moments(seeds), seeds, config)


def made(n_seeds: int = 1, **changes: Any) -> Learner:
    return learner_of(range(n_seeds), MADDPGConfig(**{**SMALL, **changes}))


def random_batch(n_seeds: int = 1, size: int = 32) -> Batch:
    g = torch.Generator().manual_seed(0)
    shape = (n_seeds, size)
    flags = torch.rand(shape, generator=g) < 0.3
    return Batch(
        observations=torch.randn(*shape, 2, 3, generator=g),
        actions=torch.rand(*shape, 2, 2, generator=g) * 2 - 1,
        rewards=torch.randn(*shape, 2, generator=g),
        next_observations=torch.randn(*shape, 2, 3, generator=g),
        states=torch.randn(*shape, 4, generator=g),
        next_states=torch.randn(*shape, 4, generator=g),
        terminations=flags,
        truncations=~flags,
        mask=torch.ones_like(flags),
        next_actions=torch.rand(*shape, 2, 2, generator=g) * 2 - 1,
        log_probs=torch.zeros(*shape, 2),
    )


def test_targets_take_the_lower_critic_robot_by_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    learner, batch = made(discount=0.5, reward_scale=2.0), random_batch()
    values = torch.tensor([[4.0, 1.0], [3.0, 5.0]])[:, None].expand(1, 2, 32, 2)  # [K, J, B, N]
    monkeypatch.setattr(learner.critics, "target_q", lambda x, actions: values)
    alive = ~batch.terminations[..., None]
    expected = 2.0 * batch.rewards + 0.5 * alive * torch.tensor([3.0, 1.0])
    torch.testing.assert_close(learner.targets(batch), expected)


def test_the_original_has_one_critic_and_no_noise() -> None:
    learner, batch = made(corrections="none", policy_delay=7), random_batch()
    assert len(learner.critics.online.flat) == 1
    assert torch.equal(learner.targets(batch), learner.targets(batch))
    assert "policy_q" in learner.update(batch)  # no delay
    o_next = learner.inputs.observations(batch.next_observations)
    a_next = learner.actions(o_next, learner.target_actors)
    x_next = learner.critics.view(batch.next_states, batch.next_observations)
    q_next = learner.critics.target_q(x_next, a_next)[:, 0]
    expected = batch.rewards + 0.97 * ~batch.terminations[..., None] * q_next
    torch.testing.assert_close(learner.targets(batch), expected)


def test_smoothing_noise_is_clipped_and_per_seed() -> None:
    learner, batch = made(2, smoothing=100.0, smoothing_clip=1e-3), random_batch(2)
    first, second = learner.targets(batch), learner.targets(batch)
    assert not torch.equal(first, second)
    torch.testing.assert_close(first, second, rtol=0, atol=0.05)
    alone = learner_of([1], learner.config)
    row = seed_of(batch, 1)
    torch.testing.assert_close(alone.targets(row)[0], first[1], rtol=0, atol=1e-5)


def test_critics_begin_apart_and_both_learn() -> None:
    learner, batch = made(), random_batch()
    before = learner.critics.online.flat.clone()
    assert not torch.equal(before[0], before[1])
    learner.update(batch)
    assert ((learner.critics.online.flat - before).abs().sum(1) > 0).all()


def test_truncation_bootstraps_and_termination_does_not() -> None:
    learner, batch = made(smoothing=0.0), random_batch()
    flags = torch.zeros_like(batch.terminations)
    cut = replace(batch, terminations=flags, truncations=~flags)
    on = replace(batch, terminations=flags, truncations=flags)
    over = replace(batch, terminations=~flags, truncations=flags)
    assert torch.equal(learner.targets(cut), learner.targets(on))
    torch.testing.assert_close(learner.targets(over), batch.rewards)
    assert not torch.allclose(learner.targets(over), learner.targets(cut))


@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_policy_gradient_by_hand(joint_gradient: Any) -> None:
    learner = made(joint_gradient=joint_gradient, logit_penalty=0.1)
    batch = random_batch()
    x = learner.critics.view(batch.states, batch.observations)
    logits = learner.actors(learner.inputs.observations(batch.observations))[0]  # [B, N, A]
    values = []
    for robot in range(2):
        mixed = batch.actions[0].clone()
        mixed[:, robot] = logits[:, robot].tanh()
        joint = mixed if joint_gradient == "own" else logits.tanh()
        values.append(learner.critics.q(x, joint[None])[0, 0, :, robot])
    loss = 0.1 * logits.square().mean() - torch.stack(values).mean()
    learner.actors.network.backward(loss)
    expected = learner.actors.network.gradient.clone()
    critics = learner.critics.online.flat.clone()
    learner._update_actors(batch, x, 1.0)
    torch.testing.assert_close(learner.actors.network.gradient, expected, rtol=1e-4, atol=1e-7)
    assert torch.equal(learner.critics.online.flat, critics)


def test_actors_and_targets_move_every_other_update() -> None:
    learner, batch = made(policy_delay=2, tau=0.5), random_batch()
    actors, target = learner.actors.network.flat.clone(), learner.critics.target.flat.clone()
    assert set(learner.update(batch)) == {"critic_loss", "q"}
    assert torch.equal(learner.actors.network.flat, actors)
    assert torch.equal(learner.critics.target.flat, target)
    assert set(learner.update(batch)) == {"critic_loss", "q", "policy_q"}
    assert not torch.equal(learner.actors.network.flat, actors)
    halfway = (target + learner.critics.online.flat) / 2
    torch.testing.assert_close(learner.critics.target.flat, halfway)


def test_actors_rest_while_the_critics_warm_up() -> None:
    learner, batch = made(critic_warmup_updates=2), random_batch()
    actors, targets = (
        learner.actors.network.flat.clone(),
        learner.critics.target.flat.clone(),
    )
    for _ in range(2):
        assert set(learner.update(batch)) == {"critic_loss", "q"}
    assert torch.equal(learner.actors.network.flat, actors)
    assert not torch.equal(learner.critics.target.flat, targets)
    assert "policy_q" in learner.update(batch)
    assert not torch.equal(learner.actors.network.flat, actors)


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_a_seed_of_a_stack_learns_what_it_learns_alone(parameters: Any) -> None:
    stack, batch = made(3, parameters=parameters), random_batch(3)
    for _ in range(20):
        stack.update(batch)
    for seed in range(3):
        alone = learner_of([seed], stack.config)
        row = seed_of(batch, seed)
        for _ in range(20):
            alone.update(row)
        ours = stack.critics.online.flat[2 * seed : 2 * seed + 2]
        torch.testing.assert_close(ours, alone.critics.online.flat, rtol=0, atol=2e-5)
        n_rows = stack.actors.n_rows
        ours = stack.actors.network.flat[n_rows * seed : n_rows * (seed + 1)]
        torch.testing.assert_close(ours, alone.actors.network.flat, rtol=0, atol=2e-5)


def test_values_bootstrap_through_truncation_only(two_episodes: Any, tmp_path: Path) -> None:
    """As in the test of VDN: rewards 1, 2, 3; even copies end after the 3, odd ones are cut."""
    config = MADDPGConfig(
        **{**SMALL, "critic_hidden": (32,)},
        n_steps=800, n_copies=4, rollout_steps=10, n_gradient_steps=12, batch_size=64, capacity=200,
        margin=80, warmup_transitions=0, frame="world", discount=0.5, critic_learning_rate=1e-2,
        tau=0.1,
    )  # fmt: skip
    run = MADDPG(two_episodes, [3], config, tmp_path)
    for _ in range(8):
        run.update()
    batch = run.collector._draw()
    x = run.learner.critics.view(batch.states, batch.observations)
    q = run.learner.critics.q(x, batch.actions).detach()[:, 0].mean(-1)
    time, even = batch.states[..., 1], batch.states[..., 2]
    for t, expected in enumerate((2.75, 3.5, 3.0)):
        assert q[(time == t) & (even == 1)].mean().item() == pytest.approx(expected, abs=0.25)
    assert q[(time == 2) & (even == 0)].mean().item() > 3.3


@pytest.mark.learns
@pytest.mark.parametrize("corrections", ["td3", "none"])
def test_it_learns_to_reach_goals(
    easy_success: Callable[[Any, Any], float], corrections: Any
) -> None:
    """Within 15 s of one core."""
    config = MADDPGConfig(n_steps=60_000, corrections=corrections)
    assert easy_success(MADDPG, config) > 0.7
