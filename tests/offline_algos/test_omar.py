"""OMAR: critics of one agent each, the search for the best action, and that it beats its data."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.offline_algos.omar import OMAR, by_agent
from tests.offline_algos.toys import made, random_batch, set_bias


def test_a_critic_sees_one_agents_observation_and_number() -> None:
    algorithm, batch = made(OMAR), random_batch(1, 4)
    x = algorithm.inputs_of(batch.observations)
    assert x.shape == (1, 8, 3 + 2)
    torch.testing.assert_close(x[0, 3, :3], batch.observations[0, 1, 1])
    assert x[0, 3, 3:].tolist() == [0, 1]
    torch.testing.assert_close(by_agent(batch.actions)[0, 3, 0], batch.actions[0, 1, 1])


def test_next_values_are_of_the_state_that_was_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm, batch = made(OMAR, discount=1.0), random_batch()

    def value(x: Tensor, actions: Tensor) -> Tensor:
        return torch.stack([x[..., :1], x[..., :1] + 1], 1)  # the first feature observed

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    on = ~batch.terminations[..., None]
    expected = batch.rewards + on * batch.next_observations[..., 0]
    torch.testing.assert_close(algorithm.targets(batch), expected.flatten(1))


@settings(deadline=None, max_examples=15)
@given(best=st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9)), scale=st.floats(0.001, 1000))
def test_the_search_finds_a_peak_whatever_the_scale_of_values(
    best: tuple[float, float], scale: float
) -> None:
    algorithm, batch = made(OMAR, n_candidates=40, n_iterations=4), random_batch()
    peak = torch.tensor(best)

    def height(x: Tensor, actions: Tensor) -> Tensor:
        return -scale * (actions - peak).square().sum((-2, -1))[..., None]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(algorithm.critics, "first_sampled_q", height)
        patch.setattr(algorithm.critics, "first_q", height)
        x = algorithm.inputs_of(batch.observations)
        far = torch.full((1, 64, 1, 2), 1.0)
        found = algorithm.search(x, far)
        assert (found - peak).norm(dim=-1).mean() < 0.3
        exact = peak.expand(1, 64, 1, 2)
        assert torch.equal(algorithm.search(x, exact), exact)  # nothing beats the policy


def test_values_without_a_spread_do_no_harm() -> None:
    algorithm, batch = made(OMAR), random_batch()
    set_bias(algorithm.critics.online, 0, 1.0)
    pi = by_agent(algorithm.actor(batch.observations))
    found = algorithm.search(algorithm.inputs_of(batch.observations), pi)
    assert found.isfinite().all()
    assert found.abs().max() <= 1
    assert not found.requires_grad
