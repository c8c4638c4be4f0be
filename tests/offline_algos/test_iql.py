"""Multi-agent IQL: in-sample targets, expectile values, joint weights, and that it improves."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.offline_algos.iql import IQL  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    actions_of,
    made,
    progress_of,
    random_batch,
    trained,
    two_episodes,
)


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    algorithm = made(IQL, discount=0.5, changes={"return_std": 2.0})

    def value(x: Tensor) -> Tensor:
        return 100 * x[..., :1] + 10 * x[..., 1:2]

    monkeypatch.setattr(algorithm, "value", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    # episode 1: 2 / 2 + V(1, 1) / 2, then 6 / 2 alone; episode 2: the cut does not stop it
    expected = torch.tensor([[1 + 55.0, 3.0, 1 + 105.0, 3 + 110.0]])
    torch.testing.assert_close(algorithm.targets(batch), expected)


def test_no_policy_enters_the_critics() -> None:
    """Two algorithms that differ in their actors only learn the same values."""
    ours, other, batch = made(IQL), made(IQL), random_batch()
    other.actor.network.flat.mul_(-2)
    for algorithm in (ours, other):
        for _ in range(5):
            algorithm.update(batch)
    assert torch.equal(ours.critics.online.flat, other.critics.online.flat)
    assert torch.equal(ours.value.flat, other.value.flat)
    assert not torch.equal(ours.actor.network.flat, other.actor.network.flat)


def test_the_weight_of_a_joint_action_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Minimum of the twins, advantage, exponential, clip; one weight for all agents of a row."""
    algorithm = made(IQL, inverse_temperature=2.0, max_weight=5.0, max_grad_norm=None)
    batch = random_batch(size=3)
    q = torch.tensor([[[0.5, 1.0, 3.0], [1.5, 0.0, 4.0]]])[..., None]  # [K, J, B, 1]
    monkeypatch.setattr(algorithm.critics, "target_q", lambda *_: q)
    with torch.no_grad():
        algorithm.value.flat.zero_()
    _, pi = algorithm.actor.along(batch)
    errors = (pi - batch.actions).square().mean((2, 3))  # [K, B]
    weights = torch.tensor([[np.exp(1.0), 1.0, 5.0]], dtype=torch.float32)
    expected = (weights * errors).mean(1).detach()
    losses = algorithm.update(batch)
    torch.testing.assert_close(losses["actor_loss"], expected)
    torch.testing.assert_close(losses["weight"], weights.mean(1))
    # tau = 0.7, all advantages 0.5, 0, 3 are above: 0.7 u^2
    torch.testing.assert_close(losses["value_loss"], torch.tensor([0.7 * (0.25 + 9) / 3]))


def test_twin_critics_differ_and_both_learn() -> None:
    algorithm = made(IQL, 2)
    before = algorithm.critics.online.flat.clone()
    assert len({tuple(row) for row in before.tolist()}) == 4
    algorithm.update(random_batch(2))
    assert (algorithm.critics.online.flat - before).abs().amax(1).min() > 0


def test_a_large_beta_does_not_overflow() -> None:
    algorithm, batch = made(IQL, inverse_temperature=1e6), random_batch()
    losses = algorithm.update(replace(batch, rewards=1e3 * batch.rewards))
    assert all(torch.isfinite(loss).all() for loss in losses.values())


@pytest.mark.learns
def test_it_improves_on_a_mixture(mixture: MemoryDataset) -> None:
    """Half of the data drive at the goal, the other half at random; cloning makes 0.045."""
    algorithm, _ = trained(IQL, mixture, 1500, batch_size=256)
    observations = mixture.transitions["observations"]
    for index in range(2):
        actions = actions_of(algorithm.policy(index), observations)
        assert progress_of(actions, observations) > 0.07  # straight at the goal: 0.16
