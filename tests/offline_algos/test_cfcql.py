"""CFCQL: the penalty looks at one agent a row, and is the mean over agents in expectation."""

import math

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.offline_algos.cfcql import CFCQL  # noqa: E402
from tests.offline_algos.toys import made, random_batch, set_bias  # noqa: E402


def test_only_one_agent_leaves_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm, batch = made(CFCQL), random_batch()
    critics, seen = algorithm.critics, []
    true = critics.sampled_q

    def record(x: Tensor, actions: Tensor) -> Tensor:
        seen.append(actions)
        return true(x, actions)

    monkeypatch.setattr(critics, "sampled_q", record)
    x = algorithm.normalizer.information(batch.states, batch.observations)
    algorithm.gap(batch, x, critics.q(x, batch.actions)[..., 0])
    left = (seen[0] != batch.actions[:, :, None]).any(-1)  # [K, B, M, N]
    assert (left.sum(3) == 1).all()
    assert (left == left[:, :, :1]).all()  # the same agent in all samples of a row
    assert left.any(2).float().mean((0, 1)).tolist() == pytest.approx([0.5, 0.5], abs=0.3)


def test_a_flat_critic_pays_the_volume_of_one_agents_actions() -> None:
    """tau log integral exp(c / tau) db = c + tau log 4 on [-1, 1]^2, however many agents."""
    algorithm, batch = made(CFCQL, temperature=0.2), random_batch()
    critics = algorithm.critics
    for row in (0, 1):
        set_bias(critics.online, row, 3.0 + row)
    x = algorithm.normalizer.information(batch.states, batch.observations)
    gap = algorithm.gap(batch, x, critics.q(x, batch.actions)[..., 0])
    torch.testing.assert_close(gap, torch.full((1, 2), 0.2 * math.log(4.0)))


def test_a_drawn_agent_estimates_the_mean_over_agents() -> None:
    """Against the same penalty with every agent, enumerated, both with many samples."""
    algorithm = made(CFCQL, n_samples=400, temperature=0.5)
    batch = random_batch(1, 300)
    with torch.no_grad():
        algorithm.critics.online.layers[0].weight.mul_(5.0)  # values that depend on actions
        x = algorithm.normalizer.information(batch.states, batch.observations)
        q = algorithm.critics.q(x, batch.actions)[..., 0]
        terms = []
        for agent in range(2):
            samples = batch.actions[:, :, None].repeat(1, 1, 400, 1, 1)
            samples[:, :, :, agent] = torch.rand(samples[:, :, :, agent].shape) * 2 - 1
            values = algorithm.critics.sampled_q(x, samples)[..., 0]
            mean = (values / 0.5).logsumexp(-1) - math.log(400)
            terms.append((0.5 * (mean + math.log(4.0)) - q).mean(2))
        expected = torch.stack(terms).mean(0)
        got = torch.stack([algorithm.gap(batch, x, q) for _ in range(4)]).mean(0)
    torch.testing.assert_close(got, expected, rtol=0, atol=0.02)
