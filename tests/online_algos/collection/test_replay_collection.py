"""Collecting: what is kept of two episodes, and what a round returns."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.errors import SchemaError, SpecError
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.online_algos.collection.replay_collection import (
    OffPolicy,
    ReplaySettings,
    epsilon_greedy,
    gaussian,
)
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.types import Batch

SMALL: dict[str, Any] = {
    "n_steps": 100, "n_copies": 4, "rollout_steps": 10, "n_gradient_steps": 1, "batch_size": 300,
    "capacity": 400, "margin": 40, "warmup_transitions": 0, "frame": "world",
}  # fmt: skip


class Watch(OffPolicy):
    """Stands still, stores 0.5, and keeps the batches that it is to learn from."""

    LOSSES = ("number", "never", "reward")

    def __init__(self, env: Any, folder: Path, n_seeds: int = 1, **changes: Any) -> None:
        self.batches: list[Batch] = []
        super().__init__(env, range(n_seeds), ReplaySettings(**{**SMALL, **changes}), folder)

    def new_learner(self) -> None:
        pass

    def explore(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        actions = torch.zeros(*observations.shape[:3], 2)
        return actions, actions + 0.5

    def learn(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        self.batches.append(batch)
        return {"number": torch.tensor([float(len(self.batches))])}


def test_next_observations_are_those_before_any_reset(two_episodes: Any, tmp_path: Path) -> None:
    """Never the next episode's first state, although every copy is reset at once."""
    run = Watch(two_episodes, tmp_path)
    run.update()
    batch = run.replay.sample(run.acting, 500)
    episode, time, even = (batch.states[..., i] for i in range(3))
    assert set(time.unique().tolist()) == {0.0, 1.0, 2.0}
    assert len(episode.unique()) > 1
    assert torch.equal(batch.next_states[..., 0], episode)
    assert torch.equal(batch.next_states[..., 1], time + 1)
    assert torch.equal(batch.next_observations[..., 0, :], batch.next_states)
    assert torch.equal(batch.observations[..., 1, :], batch.states)
    assert torch.equal(batch.terminations, (time == 2) & (even == 1))
    assert torch.equal(batch.truncations, (time == 2) & (even == 0))
    assert torch.equal(batch.rewards[..., 0], time + 1)
    assert (batch.actions == 0.5).all()


def test_a_round_learns_after_every_step_once_it_is_warm(two_episodes: Any, tmp_path: Path) -> None:
    run = Watch(two_episodes, tmp_path, warmup_transitions=20, n_gradient_steps=2)
    losses = run.update()
    assert run.frames == 40
    assert len(run.batches) == 2 * 6  # steps 5 to 10
    assert losses["number"].tolist() == [np.mean(np.arange(1, 13))]
    assert losses["never"].isnan().all()
    assert losses["reward"].item() == pytest.approx(np.mean([1, 2, 3] * 3 + [1]))
    assert run.progress == 0.4


def test_normalized_batches_keep_the_first_statistics(two_episodes: Any, tmp_path: Path) -> None:
    run = Watch(two_episodes, tmp_path)
    moments = run.moments
    run.update()
    batch = run.normalized(run.batches[-1])
    time = batch.states[..., 1] * moments.state_std[0, 1] + moments.state_mean[0, 1]
    torch.testing.assert_close(time, time.round())
    assert run.moments is moments
    mean, std = run.inputs_of(0)
    torch.testing.assert_close(mean.float(), torch.from_numpy(moments.observation_mean[0]))
    assert std.dtype == torch.float64


@pytest.mark.parametrize(
    ("capacity", "rows"),
    [(400, (30, 0)), (100, (25, 5)), (40, (10, 10))],
    ids=["room for all", "part of the margin", "both"],
)
def test_the_replay_is_no_longer_than_the_run(
    two_episodes: Any, tmp_path: Path, capacity: int, rows: tuple[int, int]
) -> None:
    """Three rounds of ten rows, of four transitions each."""
    run = Watch(two_episodes, tmp_path, capacity=capacity)
    assert (run.replay.shape.capacity, run.replay.shape.margin) == rows
    for _ in range(3):
        run.update()
    assert run.progress == 1
    assert len(run.replay) == rows[0]


def test_wrong_numbers_are_refused(two_episodes: Any, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="got 4 copies for 2 seeds, expected n_copies = 4"):
        Watch(two_episodes, tmp_path, n_seeds=2)
    with pytest.raises(SchemaError, match="at least one step of every copy"):
        ReplaySettings(capacity=3)


def test_other_reward_weights_are_learned_from(tmp_path: Path) -> None:
    """In the same worlds, robots that stand still pay twice the price of time."""
    plain, weighted = (
        Watch(make_env(preset("coop_nav-easy"), 4), tmp_path / name, reward_weights=weights)
        for name, weights in (("plain", ()), ("weighted", ("time=0.04", "success=1")))
    )
    assert preset("coop_nav-easy").rules.rewards.time == 0.02
    torch.testing.assert_close(weighted.update()["reward"], plain.update()["reward"] - 0.02)
    with pytest.raises(SpecError, match=r"reward_weights is time=0.04,success=1 and recorded data"):
        weighted.mix_in(None, 0.5)  # type: ignore[arg-type]


def test_a_value_falls_linearly_and_stays(two_episodes: Any, tmp_path: Path) -> None:
    run, found = Watch(two_episodes, tmp_path), []
    run.config = SimpleNamespace(n_steps=100, exploration=0.5)
    for run.frames in (0, 25, 50, 90):
        found.append(run.faded(1.0, 0.2))
    assert found == pytest.approx([1.0, 0.6, 0.2, 0.2])


def test_noise_has_its_deviation_and_stays_in_the_box() -> None:
    zeros = torch.zeros(2, 20_000)
    noisy = gaussian(generators([0, 1], "cpu"), zeros, 0.2)
    torch.testing.assert_close(noisy.std(1), torch.full((2,), 0.2), rtol=0.02, atol=0)
    wild = gaussian(generators([0, 1], "cpu"), zeros, 5.0)
    assert wild.abs().max() == 1
    assert torch.equal(gaussian(generators([0, 1], "cpu"), zeros, 0.0), zeros)


def test_a_robot_replaces_all_its_choices_with_probability_epsilon() -> None:
    best = torch.full((1, 4000, 3, 2), 4)
    chosen = epsilon_greedy(generators([5], "cpu"), best, 9, 0.3)
    changed = chosen != best
    # a uniform choice is the best one in 1 of 9 cases
    assert changed.float().mean().item() == pytest.approx(0.3 * 8 / 9, abs=0.01)
    both = changed.all(-1).float().mean().item()
    assert both == pytest.approx(0.3 * (8 / 9) ** 2, abs=0.01)
    _, counts = np.unique(chosen[changed].numpy(), return_counts=True)
    assert len(counts) == 8
    assert counts.max() < 1.2 * counts.min()


def test_no_epsilon_no_change() -> None:
    best = torch.randint(9, (2, 5, 3, 2), generator=torch.Generator().manual_seed(0))
    assert torch.equal(epsilon_greedy(generators([0, 1], "cpu"), best, 9, 0.0), best)


def test_streams_of_a_seed_differ() -> None:
    draws = [torch.rand(3, generator=generators([1], "cpu", s)[0]).tolist() for s in (None, 0, 1)]
    assert len({tuple(draw) for draw in draws}) == 3
