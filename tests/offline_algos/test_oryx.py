"""Oryx: returns and weights by hand, and a team that agrees because it decides in order."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.training.trainer import sampler_of
from swarmdata.offline_algos.oryx import Oryx, lambda_returns
from swarmdata.types import Float
from tests.offline_algos.toys import hinted_side, made, random_batch, step_of, trained, two_episodes
from tests.support.memory_dataset import MemoryDataset

SMALL: dict[str, Any] = {
    "width": 32, "value_hidden": (16,), "burn_in": 1, "window": 2, "n_components": 2,
}  # fmt: skip


def test_returns_of_a_window_by_hand() -> None:
    """A termination ends the sum, padding hands over to the value network, lambda mixes them."""
    rewards = torch.tensor([[[1.0], [2.0], [4.0]], [[1.0], [2.0], [4.0]]])[None]  # [1, 2, 3, 1]
    ends = torch.tensor([[[False, False, True], [False, False, False]]])[..., None]
    v = torch.tensor([[[10.0], [20.0], [30.0]], [[10.0], [20.0], [30.0]]])[None]
    mask = torch.tensor([[[True, True, True], [True, True, False]]])
    found = lambda_returns(rewards, ends, v, mask[..., None], discount=0.5, trace_decay=0.75)[
        0, ..., 0
    ]
    second = 2 + 0.5 * (0.25 * 20 + 0.75 * 4)
    assert found[0].tolist() == [1 + 0.5 * (0.25 * 10 + 0.75 * second), second, 4.0]
    second = 2 + 0.5 * 20
    assert found[1, :2].tolist() == [1 + 0.5 * (0.25 * 10 + 0.75 * second), second]


def test_returns_of_recorded_episodes_end_as_they_did() -> None:
    """With V' 0 everywhere and lambda 1, a return is the discounted sum to the end of a window."""
    settings = {**SMALL, "window": 2, "burn_in": 0, "discount": 0.5, "trace_decay": 1.0}
    algorithm = made(Oryx, reward="team", **settings)
    algorithm.descent.targets["value"].flat.zero_()
    data = two_episodes()
    sampler = sampler_of(data, algorithm.config, 0)
    batch = sampler.gather(np.array([[0, 2]])).to_torch()  # team rewards of both: 2, 6
    assert algorithm.returns(batch)[0, :, 0].tolist() == [5.0, 6.0, 5.0, 6.0]
    target = algorithm.descent.targets["value"]
    target.flat.zero_()
    with torch.no_grad():
        target.layers[-1].bias.fill_(8.0)
    assert algorithm.returns(batch)[0, :, 0].tolist() == [5.0, 6.0, 7.0, 10.0]  # the second is cut


def test_with_one_component_and_no_weights_the_loss_is_the_squared_error() -> None:
    algorithm = made(Oryx, **{**SMALL, "n_components": 1, "inverse_temperature": 0.0})
    batch = sampler_of(hinted_side(3), algorithm.config, 0).gather(np.arange(16)[None]).to_torch()
    steps, outputs = algorithm.actor.along(batch)
    expected = (outputs[..., 1:].tanh() - steps.actions).square().mean((1, 2, 3))
    torch.testing.assert_close(algorithm.update(batch)["actor_loss"], expected.detach())
    there = torch.ones_like(batch.rewards, dtype=torch.bool)
    there[..., 0] = False  # one robot has left
    ends = torch.zeros_like(there)
    gone = replace(batch, alive=there, next_alive=there, agent_terminations=ends)
    assert algorithm.update(gone)["effective_share"].item() == pytest.approx(1.0)


@pytest.mark.slow
def test_better_actions_weigh_more() -> None:
    """Of two actions in the same state, one is worth 1 and one 0: the mode is the good one."""
    data = hinted_side(40)
    episodes = [
        replace(
            e, rewards=(e.actions[..., 1] > 0).astype(np.float32), observations=e.observations * 0
        )
        for e in data.episodes
    ]
    algorithm, losses = trained(
        Oryx, MemoryDataset(episodes), 150, joint=False, inverse_temperature=1.5, **SMALL,
        discount=0.0,
    )  # fmt: skip
    step = step_of(20)
    step = step._replace(observations=step.observations * 0)
    policy = algorithm.policy(0)
    policy.reset(step, np.arange(20))
    assert (policy.act(step)[..., 1] > 0.5).all()
    assert losses[-1]["effective_share"] < 0.7


def test_transitions_are_refused() -> None:
    with pytest.raises(SchemaError, match="expected windows"):
        made(Oryx, **SMALL).update(random_batch())


def sides(policy_of: Oryx, seed: int) -> Float:
    """What both robots choose in 300 fresh steps, [300, 2]."""
    policy = policy_of.policy(seed)
    observations = np.concatenate([e.observations[:-1] for e in hinted_side(15, seed=9)])
    step = step_of(len(observations))._replace(observations=observations)
    policy.reset(step, np.arange(len(observations)))
    return policy.act(step)[..., 1]


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "low", "high"), [(True, 0.97, 1.0), (False, 0.35, 0.7)])
def test_only_who_decides_in_order_agrees(joint: bool, low: float, high: float) -> None:
    """Both sides are right if both robots take it: robots that act alone agree in half of steps."""
    algorithm, _ = trained(Oryx, hinted_side(), 300, joint=joint, batch_size=64, **SMALL)
    found = np.stack([sides(algorithm, seed) for seed in (0, 1)])
    assert (np.abs(np.abs(found) - 0.8) < 0.2).mean() > 0.9  # a side, not the middle
    assert low < (found[..., 0] * found[..., 1] > 0).mean() <= high
