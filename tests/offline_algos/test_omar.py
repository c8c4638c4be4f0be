"""OMAR: critics of one agent each, the search for the best action, and that it beats its data."""

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from torch import Tensor  # noqa: E402

from swarmdata.offline_algos.omar import OMAR, by_agent  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    made,
    progress_of,
    random_batch,
    set_bias,
    trained,
    two_episodes,
)


def test_a_critic_sees_one_agents_observation_and_number() -> None:
    algorithm, batch = made(OMAR), random_batch(1, 4)
    x = algorithm.inputs_of(batch.observations)
    assert x.shape == (1, 8, 3 + 2)
    torch.testing.assert_close(x[0, 3, :3], batch.observations[0, 1, 1])
    assert x[0, 3, 3:].tolist() == [0, 1]
    torch.testing.assert_close(by_agent(batch.actions)[0, 3, 0], batch.actions[0, 1, 1])


def test_targets_are_of_the_agents_own_reward_and_stop_at_terminations_only() -> None:
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    algorithm = made(OMAR, changes={"own_return_std": 2.0}, discount=0.5)
    for row, value in ((0, 9.0), (1, 8.0)):  # the smaller twin counts
        set_bias(algorithm.critics.target, row, value)
    y = algorithm.targets(batch).view(4, 2)
    expected = [[0.5 + 4, 1.5 + 4], [2.5, 3.5], [0.5 + 4, 1.5 + 4], [2.5 + 4, 3.5 + 4]]
    torch.testing.assert_close(y, torch.tensor(expected))


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


def test_each_critic_is_penalized_for_its_own_values() -> None:
    algorithm, batch = made(OMAR, n_samples=5), random_batch()
    x, actions = algorithm.inputs_of(batch.observations), by_agent(batch.actions)
    for critic in range(2):
        gap = algorithm.gap(x, actions, algorithm.critics.q(x, actions)[..., 0])
        algorithm.critics.online.backward(gap[0, critic])
        moved = algorithm.critics.online.gradient.abs().sum(1)
        assert moved[critic] > 0
        assert moved[1 - critic] == 0


def test_twins_begin_apart_and_the_actors_step_leaves_them_alone() -> None:
    algorithm, batch = made(OMAR, n_samples=5), random_batch()
    critics = algorithm.critics.online
    assert not torch.equal(*critics.flat)
    algorithm.update(batch)
    assert critics.gradient.norm(dim=1).min() > 0
    parameters, gradient = critics.flat.clone(), critics.gradient.clone()
    pi = algorithm.actor(batch.observations)
    loss = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, torch.zeros(1))
    algorithm.actor.step(loss.total)
    assert set(loss.reported) == {"policy_q", "search_loss"}
    assert torch.equal(critics.flat, parameters)
    assert torch.equal(critics.gradient, gradient)


@pytest.mark.learns
def test_it_beats_its_data(mixture: MemoryDataset) -> None:
    """As the other conservative algorithms: 0 is the data's progress, 0.045 that of a clone."""
    settings: dict[str, Any] = {
        "critic_learning_rate": 1e-3,
        "bc_warmup_updates": 200,
        "n_samples": 4,
    }
    algorithm, _ = trained(OMAR, mixture, 800, **settings)
    observations = mixture.transitions["observations"]
    for index in range(2):
        learned = progress_of(algorithm.policy(index).actions(observations), observations)
        assert learned > 0.08
