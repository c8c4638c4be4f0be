"""MAC-Flow: targets, what climbs which values, the stages, and that it improves on its data."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import Reward
from swarmdata.offline_algos.mac_flow import N_DRAWS, MACFlow
from swarmdata.types import Batch
from tests.offline_algos.toys import made, random_batch, set_bias, two_episodes

TINY: dict[str, Any] = {"flow_hidden": (8,), "n_flow_steps": 2}


def value(states: Tensor) -> Tensor:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    return 100 * states[..., 0] + 10 * states[..., 1]


def targets(algorithm: MACFlow, batch: Batch) -> Tensor:
    return algorithm.targets(algorithm.copy.actor.see(batch))


def test_the_teams_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm = made(MACFlow, discount=0.5, reward="team", **TINY)

    def target_q(states: Tensor, observations: Tensor, actions: Tensor) -> Tensor:
        return torch.stack([value(states), value(states) + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", target_q)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    expected = torch.tensor([[2 + 55.0, 6.0, 2 + 105.0, 6 + 110.0]])
    torch.testing.assert_close(targets(algorithm, batch), expected)


def test_each_robots_target_has_its_own_reward(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm = made(MACFlow, discount=0.5, **TINY)

    def agent_values(*_: object) -> Tensor:
        robots = torch.tensor([10.0, 20.0]).expand(1, 4, 2)
        return torch.stack([robots + 1, robots], 1)  # [K, 2, B, N]

    monkeypatch.setattr(algorithm.critics, "agent_values", agent_values)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    expected = [1 + 5.0, 3 + 10.0, 5.0, 7.0, 1 + 5.0, 3 + 10.0, 5 + 5.0, 7 + 10.0]
    torch.testing.assert_close(targets(algorithm, batch), torch.tensor([expected]))


@pytest.mark.parametrize("reward", ["own", "team"])
@pytest.mark.parametrize(("clip", "worth"), [(True, 1.5), (False, 5.0)])  # R* / scale is 1.5
def test_next_values_are_the_slow_copies_and_bounded(reward: str, clip: bool, worth: float) -> None:
    batch, changes = random_batch(), {"return_std": 2.0, "max_return": 3.0}
    changes |= {f"own_{name}": value for name, value in changes.items()}
    algorithm = made(
        MACFlow, changes=changes, discount=0.9, clip_target=clip, reward=reward, **TINY
    )
    for row, (online, slow) in enumerate(((1.0, 6.0), (2.0, 5.0))):
        set_bias(algorithm.critics.utilities, row, online)
        set_bias(algorithm.critics.target_utilities, row, slow)
    rewards = batch.rewards if reward == "own" else batch.rewards.mean(-1, keepdim=True)
    expected = rewards / 2 + 0.9 * worth * ~batch.terminations[..., None]
    torch.testing.assert_close(targets(algorithm, batch), expected.flatten(1))


REWARDS: tuple[Reward, ...] = ("own", "team")


def measured(reward: Reward) -> tuple[MACFlow, Batch]:
    """Critics that differ visibly, and what was measured of them."""
    algorithm, batch = made(MACFlow, reward=reward, slope_limit=1e6, **TINY), random_batch()
    with torch.no_grad():
        algorithm.critics.utilities.layers[-1].weight.mul_(200.0)
    algorithm.measure_climb(batch.states, batch.observations, batch)
    return algorithm, batch


def worth(algorithm: MACFlow, batch: Batch, pi: Tensor) -> Tensor:
    """The smaller twin's sum over robots, or the team's value, [K, B]; moments are 0 and 1."""
    if algorithm.config.reward == "own":
        return algorithm.critics.agent_values(batch.observations, pi).amin(1).sum(2)
    return algorithm.critics.q(batch.states, batch.observations, pi).amin(1)


@pytest.mark.parametrize("reward", REWARDS)
def test_actors_climb_the_smaller_value_of_what_the_reward_is_of(reward: Reward) -> None:
    algorithm, batch = measured(reward)
    pi = torch.zeros(1, 32, 2, 2, requires_grad=True)
    loss, reported = algorithm.climb_loss(batch.states, batch.observations, pi, None)
    (found,) = torch.autograd.grad(loss.sum(), pi)
    weight = algorithm.climb.weight / (32 * 2)  # a mean over rows and robots
    (expected,) = torch.autograd.grad(-(weight * worth(algorithm, batch, pi)).sum(), pi)
    torch.testing.assert_close(found, expected)
    n_robots = 2 if reward == "own" else 1
    value = worth(algorithm, batch, pi).mean(1) / n_robots
    torch.testing.assert_close(reported, {"policy_q": value, "lambda": algorithm.climb.weight})


@pytest.mark.parametrize("reward", REWARDS)
def test_the_climb_is_measured_on_samples_of_the_flow(
    reward: Reward, monkeypatch: pytest.MonkeyPatch
) -> None:
    algorithm, batch = made(MACFlow, reward=reward, **TINY), random_batch()
    sampled, seen = list(torch.randn(N_DRAWS, 1, 32, 2, 2)), []
    left = iter(sampled)
    monkeypatch.setattr(algorithm.copy.flow, "sample", lambda *_: next(left))
    monkeypatch.setattr(algorithm.climb, "measure", lambda *found: seen.append(found))
    algorithm.measure_climb(batch.states, batch.observations, batch)
    ((samples, noise, value_of, alive),) = seen
    assert alive is None
    assert torch.equal(samples, torch.stack(sampled, 3))
    assert noise.shape == (1, 32, 2, N_DRAWS, 2)
    joint = batch.actions.clone()
    joint[:, :, 1] = noise[:, :, 1, 2]  # robot 1 alone leaves the data
    if reward == "own":
        one = algorithm.critics.agent_values(batch.observations, joint).amin(1)[..., 1]
    else:
        one = algorithm.critics.q(batch.states, batch.observations, joint).amin(1)
    torch.testing.assert_close(value_of(noise)[:, :, 1, 2], one)


def test_a_flow_that_fits_badly_does_not_climb_further(monkeypatch: pytest.MonkeyPatch) -> None:
    weights = []
    for misfit in (0.0, 0.5):
        algorithm, batch = made(MACFlow, **TINY), random_batch()
        around = batch.actions + misfit
        monkeypatch.setattr(
            algorithm.copy.flow, "sample", lambda x, z, alive, around=around: around + 0.1 * z
        )
        algorithm.measure_climb(batch.states, batch.observations, batch)
        weights.append(float(algorithm.climb.weight * algorithm.climb.slope))
    assert weights[0] == pytest.approx(2 * 0.01, rel=0.3)  # 2 eta v / A
    assert weights[1] == pytest.approx(weights[0])


def parts_that_move(algorithm: MACFlow) -> tuple[set[str], set[str]]:
    """Names of the networks that one update moves, and of the losses that it returns."""
    before = algorithm.state_dict()
    losses = algorithm.update(random_batch())
    after = algorithm.state_dict()
    names = ("teacher", "actor", "utilities", "target_utilities")
    return {name for name in names if not torch.equal(before[name], after[name])}, set(losses)


def test_one_stage_moves_all_in_every_update() -> None:
    algorithm = made(MACFlow, critic_share=0.0, n_updates=2, **TINY)
    parts = {"teacher", "actor", "utilities", "target_utilities"}
    assert [parts_that_move(algorithm) for _ in range(2)] == [(parts, set(MACFlow.LOSSES))] * 2


def test_in_the_second_stage_actors_climb_what_stands_still() -> None:
    algorithm = made(MACFlow, critic_share=0.5, n_updates=4, **TINY)
    copied = {"distillation_loss"}
    first = copied | {"critic_loss", "q", "flow_loss"}
    moved = [parts_that_move(algorithm) for _ in range(4)]
    assert moved[0] == moved[1] == ({"teacher", "actor", "utilities", "target_utilities"}, first)
    assert moved[2] == moved[3] == ({"actor"}, copied | {"policy_q", "lambda"})
