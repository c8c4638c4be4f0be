"""MADDPG: targets and corrections, policy gradients, and what moves when."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.online_algos.collection.input_moments import InputMoments
from swarmdata.online_algos.maddpg import Learner, MADDPGConfig
from tests.offline_algos.toys import SIZES, random_batch, seed_of

SMALL: dict[str, Any] = {
    "actor_hidden": (16,),
    "critic_hidden": (16,),
    "policy_delay": 1,
    "max_grad_norm": None,
}


def moments(seeds: Sequence[int]) -> InputMoments:
    """Other moments for each seed."""
    n, o, s = np.array(seeds)[:, None] / 4, np.ones((1, 3)), np.ones((1, 4))
    return InputMoments(n * o, n + o, n * s, n + s)


def learner_of(seeds: Sequence[int], config: MADDPGConfig) -> Learner:
    return Learner(SIZES, moments(seeds), seeds, config)


def made(n_seeds: int = 1, **changes: Any) -> Learner:
    return learner_of(range(n_seeds), MADDPGConfig(**{**SMALL, **changes}))


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
    actors, targets = (learner.actors.network.flat.clone(), learner.critics.target.flat.clone())
    for _ in range(2):
        assert set(learner.update(batch)) == {"critic_loss", "q"}
    assert torch.equal(learner.actors.network.flat, actors)
    assert not torch.equal(learner.critics.target.flat, targets)
    assert "policy_q" in learner.update(batch)
    assert not torch.equal(learner.actors.network.flat, actors)
