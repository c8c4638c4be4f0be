"""Collecting: what is kept of two episodes, and what a round returns."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from torch import Tensor  # noqa: E402

from swarmdata.errors import SchemaError, SpecError  # noqa: E402
from swarmdata.online_algos.collection.replay_collection import Collector, ReplaySettings  # noqa: E402
from swarmdata.registry.components import make_env  # noqa: E402
from swarmdata.registry.presets import preset  # noqa: E402
from swarmdata.types import Batch  # noqa: E402


def plan(**changes: Any) -> ReplaySettings:
    small: dict[str, Any] = {
        "n_steps": 100,
        "n_copies": 4,
        "rollout_steps": 10,
        "n_gradient_steps": 1,
        "batch_size": 300,
        "capacity": 400,
        "margin": 40,
        "warmup_transitions": 0,
        "frame": "world",
    }
    return ReplaySettings(**{**small, **changes})


def act(observations: Tensor) -> tuple[Tensor, Tensor]:
    actions = torch.zeros(*observations.shape[:3], 2)
    return actions, actions + 0.5


class Watch:
    """Counts batches and keeps the last."""

    def __init__(self) -> None:
        self.batches: list[Batch] = []

    def __call__(self, batch: Batch) -> dict[str, Tensor]:
        self.batches.append(batch)
        return {"number": torch.tensor([float(len(self.batches))])}


def test_next_observations_are_those_before_any_reset(two_episodes: Any, tmp_path: Path) -> None:
    """Never the next episode's first state, although every copy is reset at once."""
    collector = Collector(two_episodes, [3], plan(), tmp_path)
    collector.round(act, lambda _: {}, [])
    batch = collector.replay.sample(collector.acting, 500)
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
    collector, learn = (
        Collector(two_episodes, [3], plan(warmup_transitions=20, n_gradient_steps=2), tmp_path),
        Watch(),
    )
    losses = collector.round(act, learn, ["number", "never"])
    assert collector.frames == 40
    assert len(learn.batches) == 2 * 6  # steps 5 to 10
    assert losses["number"].tolist() == [np.mean(np.arange(1, 13))]
    assert losses["never"].isnan().all()
    assert losses["reward"].item() == pytest.approx(np.mean([1, 2, 3] * 3 + [1]))
    assert collector.progress == 0.4


def test_normalized_batches_keep_the_first_statistics(two_episodes: Any, tmp_path: Path) -> None:
    collector, learn = Collector(two_episodes, [3], plan(), tmp_path), Watch()
    moments = collector.moments
    collector.round(act, learn, ["number"])
    batch = collector.normalized(learn.batches[-1])
    time = batch.states[..., 1] * moments.state_std[0, 1] + moments.state_mean[0, 1]
    torch.testing.assert_close(time, time.round())
    assert collector.moments is moments
    mean, std = collector.inputs_of(0)
    torch.testing.assert_close(mean.float(), torch.from_numpy(moments.observation_mean[0]))
    assert std.dtype == torch.float64


def test_wrong_numbers_are_refused(two_episodes: Any, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="got 4 copies for 2 seeds, expected n_copies = 4"):
        Collector(two_episodes, [3, 4], plan(), tmp_path)
    with pytest.raises(SchemaError, match="positive counts"):
        plan(n_gradient_steps=0)
    with pytest.raises(SchemaError, match="at least one step of every copy"):
        plan(capacity=3)


def test_other_reward_weights_are_learned_from(tmp_path: Path) -> None:
    """In the same worlds, robots that stand still pay twice the price of time."""
    rewards = []
    for weights in ((), ("time=0.04", "success=1")):
        chosen = plan(reward_weights=weights)
        env = make_env(preset("coop_nav-easy"), 4)
        collector = Collector(env, [3], chosen, tmp_path / str(len(weights)))
        rewards.append(collector.round(act, lambda _: {}, [])["reward"])
    assert preset("coop_nav-easy").rules.rewards.time == 0.02
    torch.testing.assert_close(rewards[1], rewards[0] - 0.02)


def test_recorded_rows_have_the_rewards_of_the_task(two_episodes: Any, tmp_path: Path) -> None:
    collector = Collector(two_episodes, [3], plan(), tmp_path)
    collector.plan = plan(reward_weights=("time=0.04",))
    with pytest.raises(SpecError, match=r"reward_weights is time=0.04 and recorded data"):
        collector.mix_in(None, 0.5)  # type: ignore[arg-type]
