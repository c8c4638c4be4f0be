"""CFCQL: the penalty lets one robot leave the data, and is the mean over robots."""

import math

import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.critics import RobotView
from swarmdata.offline_algos.cfcql import CFCQL
from tests.offline_algos.toys import made, random_batch, set_bias


def test_only_one_robot_leaves_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm, batch = made(CFCQL), random_batch()
    algorithm.generators[0].manual_seed(9)  # not the numbers of the batch
    critics, seen = algorithm.critics, []
    true = critics.sampled_q

    def record(view: RobotView, own: Tensor, others: Tensor) -> Tensor:
        seen.append((own, others))
        return true(view, own, others)

    monkeypatch.setattr(critics, "sampled_q", record)
    x = algorithm.critic_inputs(batch)
    algorithm.gap(batch, x, critics.q(x, batch.actions))
    own, others = seen[0]
    assert (own != batch.actions[:, :, None]).all()
    assert torch.equal(others, batch.actions[:, :, None].expand_as(others))


def test_a_flat_critic_pays_the_volume_of_one_robots_actions() -> None:
    """tau log integral exp(c / tau) db = c + tau log 4 on [-1, 1]^2, however many robots."""
    algorithm, batch = made(CFCQL, temperature=0.2), random_batch()
    critics = algorithm.critics
    for row in (0, 1):
        set_bias(critics.online, row, 3.0 + row)
    x = algorithm.critic_inputs(batch)
    gap = algorithm.gap(batch, x, critics.q(x, batch.actions))
    torch.testing.assert_close(gap, torch.full((1, 2), 0.2 * math.log(4.0)))


def test_the_penalty_is_the_mean_over_robots_of_their_own_values() -> None:
    """Against each robot's penalty by itself, from its own value, both with many samples."""
    algorithm = made(CFCQL, n_samples=400, temperature=0.5)
    batch = random_batch(1, 200)
    with torch.no_grad():
        algorithm.critics.online.layers[0].weight.mul_(5.0)  # values that depend on actions
        x = algorithm.critic_inputs(batch)
        q = algorithm.critics.q(x, batch.actions)  # [K, J, B, N]
        terms = []
        for robot in range(2):
            joint = batch.actions[:, :, None].repeat(1, 1, 400, 1, 1)
            joint[:, :, :, robot] = torch.rand(joint[:, :, :, robot].shape) * 2 - 1
            values = algorithm.critics.sampled_q(x, joint, joint)[:, :, :, robot]
            mean = (values / 0.5).logsumexp(-1) - math.log(400)
            terms.append((0.5 * (mean + math.log(4.0)) - q[..., robot]).mean(2))
        expected = torch.stack(terms).mean(0)
        got = torch.stack([algorithm.gap(batch, x, q) for _ in range(4)]).mean(0)
    torch.testing.assert_close(got, expected, rtol=0, atol=0.02)
