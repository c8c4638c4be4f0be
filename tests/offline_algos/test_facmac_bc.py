"""FACMAC+BC: targets, the centralized policy gradient, and that it improves on its data."""

from typing import Literal

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.offline_algos.facmac_bc import FACMACBC, MIXERS  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    made,
    progress_of,
    random_batch,
    trained,
    two_episodes,
)


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    algorithm = made(FACMACBC, discount=0.5)

    def value(states: Tensor, observations: Tensor, actions: Tensor) -> Tensor:
        v = 100 * states[..., 0] + 10 * states[..., 1]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = algorithm.targets(batch)
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    torch.testing.assert_close(y, torch.tensor([[2 + 55.0, 6.0, 2 + 105.0, 6 + 110.0]]))


def test_targets_have_the_reward_scale_and_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = random_batch()
    team = batch.rewards.mean(-1)
    for clip, worth in ((True, 1.5), (False, 5.0)):  # R* / scale is 1.5
        algorithm = made(
            FACMACBC, changes={"return_std": 2.0, "max_return": 3.0}, discount=0.9, clip_target=clip
        )
        monkeypatch.setattr(algorithm.critics, "target_q", lambda *_: torch.full((1, 2, 32), 5.0))
        expected = team / 2 + 0.9 * worth * ~batch.terminations
        torch.testing.assert_close(algorithm.targets(batch), expected)


@pytest.mark.parametrize("mixer", MIXERS)
def test_the_policy_gradient_is_that_of_the_written_loss(mixer: str) -> None:
    """Every agent's action is the policy's; lambda is a constant; the critics do not move."""
    algorithm = made(FACMACBC, mixer=mixer, rl_weight=0.6, max_grad_norm=None)
    batch, critics = random_batch(), algorithm.critics
    with torch.no_grad():
        critics.utilities.layers[-1].weight.mul_(200.0)
    before = critics.state_dict()
    pi = algorithm.actor(batch.observations)
    q = critics.q(batch.states, batch.observations, pi)[:, 0]  # moments are 0 and 1
    weight = 0.6 / max(q.abs().mean().item(), 1.0)
    loss = -weight * q.mean() + (pi - batch.actions).square().mean()
    network = algorithm.actor.online.network
    network.backward(loss)
    expected = network.gradient.clone()
    pi = algorithm.actor(batch.observations)
    bc_loss = algorithm.bc_loss(pi, batch.actions)
    total, reported = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, bc_loss)
    algorithm.actor.step(total)
    torch.testing.assert_close(network.gradient, expected, rtol=1e-4, atol=1e-6)
    assert reported["lambda"].item() == pytest.approx(weight, rel=1e-5)
    for name, tensor in critics.state_dict().items():
        assert torch.equal(tensor, before[name]), name


def test_a_robot_is_pulled_as_hard_in_a_team_of_any_size() -> None:
    """N times the slope of each term, a mean, in one robot's action is that robot's own."""
    algorithm, batch = made(FACMACBC, mixer="mean"), random_batch()
    pi = torch.zeros(1, 32, 2, 2, requires_grad=True)
    none = torch.zeros(1)
    value, _ = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, none)
    data = algorithm.bc_loss(pi, batch.actions)
    (of_value,), (of_data,) = (torch.autograd.grad(x.sum(), pi) for x in (value, data))
    q = algorithm.critics.agent_values(batch.observations, pi)[:, 0]  # [K, B, N]
    assert q.mean(2).abs().mean() < 1  # lambda is alpha
    (own_value,) = torch.autograd.grad(-algorithm.config.rl_weight * q[..., 0].mean(), pi)
    (own_data,) = torch.autograd.grad((pi - batch.actions)[:, :, 0].square().mean(), pi)
    torch.testing.assert_close(2 * of_value[:, :, 0], own_value[:, :, 0])
    torch.testing.assert_close(2 * of_data[:, :, 0], own_data[:, :, 0])


def test_the_policy_gradient_reaches_each_agent_through_the_mixer() -> None:
    algorithm, batch = made(FACMACBC), random_batch()
    pi = algorithm.actor(batch.observations).detach().requires_grad_()
    q = algorithm.critics.policy_values(batch.states, batch.observations, pi)
    (slope,) = torch.autograd.grad(q.sum(), pi)
    assert slope.abs().amax((0, 1, 3)).min() > 0


def test_warmup_delay_and_slow_copies() -> None:
    algorithm, batch = made(FACMACBC, bc_warmup_updates=2, policy_delay=2, tau=0.5), random_batch()
    keys = [set(algorithm.update(batch)) - {"critic_loss", "q"} for _ in range(5)]
    assert keys == [{"bc_loss"}, {"bc_loss"}, set(), {"bc_loss", "policy_q", "lambda"}, set()]
    target = algorithm.critics.target_utilities.flat.clone()
    algorithm.update(batch)
    halfway = (target + algorithm.critics.utilities.flat) / 2
    torch.testing.assert_close(algorithm.critics.target_utilities.flat, halfway)


def test_an_unknown_mixer_is_refused() -> None:
    with pytest.raises(KeyError, match="linear"):
        made(FACMACBC, mixer="linear")


@pytest.mark.learns
@pytest.mark.parametrize("mixer", ["monotonic", "free"])
def test_it_improves_on_a_mixture(
    mixture: MemoryDataset, mixer: Literal["monotonic", "free"]
) -> None:
    """Half of the data drive at the goal, the other half at random; cloning makes 0.045."""
    algorithm, _ = trained(
        FACMACBC,
        mixture,
        1500,
        batch_size=256,
        bc_warmup_updates=300,
        mixer=mixer,
    )
    observations = mixture.transitions["observations"]
    for index in range(2):
        actions = algorithm.policy(index).actions(observations)
        assert progress_of(actions, observations) > 0.08  # straight at the goal: 0.16
