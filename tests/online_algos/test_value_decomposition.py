"""VDN and QMIX: double Q targets, discrete games, exploration, and their policies."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.choices import bins
from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.networks.setup import Sizes
from swarmdata.online_algos.collection.input_moments import SeedNormalizer
from swarmdata.online_algos.qmix import QMIXConfig, QMIXLearner
from swarmdata.online_algos.vdn import VDN, VDNConfig, VDNLearner, greedy_choices
from swarmdata.types import Batch
from tests.offline_algos.toys import random_batch as toy_batch

N_AGENTS, N_BINS, N_DIMENSIONS = 2, 3, 2
SETTINGS: dict[str, Any] = {
    "n_bins": N_BINS,
    "hidden": (16,),
    "discount": 0.5,
    "reward_scale": 2.0,
    "learning_rate": 1e-2,
    "tau": 0.25,
    "max_grad_norm": None,
}


def made(
    kind: str = "mean",
    n_seeds: int = 2,
    *,
    n_dimensions: int = N_DIMENSIONS,
    n_inputs: int = 3,
    **changes: Any,
) -> VDNLearner | QMIXLearner:
    sizes = Sizes(N_AGENTS, n_inputs, n_dimensions, 4)
    settings = {**SETTINGS, **changes}
    if kind == "mean":
        return VDNLearner(sizes, range(n_seeds), VDNConfig(**settings))
    mixing = QMIXConfig(**settings, mixer_embedding=8, mixer_hidden=8)
    return QMIXLearner(sizes, range(n_seeds), mixing)


def random_batch() -> Batch:
    """Transitions whose actions are bins."""
    batch = toy_batch(2, 12)
    return replace(batch, actions=((batch.actions + 1) * 1.5).floor())


@pytest.mark.parametrize("kind", ["mean", "monotonic"])
def test_the_online_networks_choose_and_the_targets_value(kind: str) -> None:
    learner, batch = made(kind), random_batch()
    learner.descent.targets["team"].flat.normal_(generator=torch.Generator().manual_seed(1))
    y = learner.targets(batch)
    k, b = 1, 7
    seen = batch.next_observations[k : k + 1, b : b + 1]
    both = seen.expand(2, -1, -1, -1)
    online = learner.utilities(both)[k, 0, 0]  # [N, D, C]
    target = learner.utilities(both, learner.descent.targets["team"])[k, 0, 0]
    values = []
    for robot in range(N_AGENTS):
        picked = [target[robot, d, int(online[robot, d].argmax())] for d in range(N_DIMENSIONS)]
        values.append(torch.stack(picked).mean())
    q = torch.stack(values)[None, None].expand(2, 1, -1)
    x_next = information(batch.next_states[:, b : b + 1], batch.next_observations[:, b : b + 1])
    if isinstance(learner, QMIXLearner):
        mixed = learner.mixer(q, x_next, learner.descent.targets["mixer"])[k, 0]
    else:
        mixed = q.mean(-1)[k, 0]
    alive = 0.0 if batch.terminations[k, b] else 1.0
    expected = 2.0 * batch.rewards[k, b].mean() + 0.5 * alive * mixed
    torch.testing.assert_close(y[k, b], expected)


@pytest.mark.parametrize("kind", ["mean", "monotonic"])
def test_a_step_moves_everything_towards_the_targets(kind: str) -> None:
    learner, batch = made(kind), random_batch()
    frozen = learner.targets(batch)

    def error() -> Tensor:
        q = learner.value(batch.observations, batch.states, batch.actions.long())[:, 0]
        return (q - frozen).abs().mean(1).detach()

    before, networks = error(), learner.descent.networks
    old = {name: network.flat.clone() for name, network in networks.items()}
    for _ in range(20):
        learner.update(batch)
    assert (error() < before).all()
    for name, network in networks.items():
        assert not torch.equal(network.flat, old[name]), name


def play(payoff: Tensor, kind: str) -> tuple[Tensor, Tensor]:
    """Trains on every cell of a two-robot matrix game; returns Q_tot [C, C] and greedy choices.

    A discrete action space is one dimension of choices; the game ends after one step.
    """
    rates = {"discount": 0.9, "reward_scale": 1.0, "tau": 0.1}
    learner = made(kind, 1, n_dimensions=1, n_inputs=1, **rates)
    cells = torch.cartesian_prod(torch.arange(3), torch.arange(3))[None]  # [1, 9, 2]
    ones = torch.ones(1, 9, dtype=torch.bool)
    batch = Batch(
        observations=torch.ones(1, 9, 2, 1),
        actions=cells[..., None].float(),
        rewards=payoff[cells[..., 0], cells[..., 1]][..., None].expand(-1, -1, 2),
        next_observations=torch.ones(1, 9, 2, 1),
        states=torch.ones(1, 9, 4),
        next_states=torch.ones(1, 9, 4),
        terminations=ones,
        truncations=~ones,
        mask=ones,
    )
    for _ in range(500):
        learner.update(batch)
    q = learner.value(batch.observations, batch.states, cells[..., None]).detach().view(3, 3)
    return q, learner.utilities(batch.observations).argmax(-1)[0, 0, 0, :, 0]


@pytest.mark.slow
def test_a_sum_of_values_is_found_by_both() -> None:
    payoff = torch.tensor([0.0, 1.0, 3.0])[:, None] + torch.tensor([2.0, 0.0, 1.0])
    for kind in ("mean", "monotonic"):
        q, choices = play(payoff, kind)
        torch.testing.assert_close(q, payoff, rtol=0, atol=0.1)
        assert choices.tolist() == [2, 0]


@pytest.mark.slow
def test_a_monotonic_game_is_one_that_only_qmix_can_write_down() -> None:
    """Both must do their part for the reward: monotonic in each robot's choice, and no sum."""
    payoff = torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 8.0]])
    q, choices = play(payoff, "monotonic")
    torch.testing.assert_close(q, payoff, rtol=0, atol=0.3)
    assert choices.tolist() == [2, 2]
    additive, _ = play(payoff, "mean")
    assert (additive - payoff).abs().max() > 1.0


LOOP: dict[str, Any] = {
    "n_steps": 400,
    "n_copies": 4,
    "rollout_steps": 10,
    "batch_size": 64,
    "capacity": 200,
    "margin": 80,
    "warmup_transitions": 0,
    "hidden": (8,),
    "frame": "world",
    "n_bins": 3,
}


def loop_of(env: Any, folder: Path, **changes: Any) -> VDN:
    return VDN(env, [3], VDNConfig(**{**LOOP, **changes}), folder)


def test_robots_take_bins_and_the_replay_keeps_them(two_episodes: Any, tmp_path: Path) -> None:
    run = loop_of(two_episodes, tmp_path)
    seen = torch.randn(1, 4, 2, 3)
    actions, kept = run.explore(seen)
    assert actions.shape == kept.shape == (1, 4, 2, 2)
    torch.testing.assert_close(actions, bins.bin_values(3)[kept.long()])
    run.update()
    choices = run.replay.sample(run.acting, 200).actions
    assert set(choices.unique().tolist()) == {0.0, 1.0, 2.0}


def test_exploration_falls_with_the_frames(two_episodes: Any, tmp_path: Path) -> None:
    run = loop_of(two_episodes, tmp_path, final_epsilon=0.0, exploration=0.5)
    seen = torch.randn(1, 4, 2, 3)
    best = greedy_choices(run.learner.utilities(seen)).float()
    early = torch.stack([run.explore(seen)[1] for _ in range(200)])
    run.frames = 200  # half of the training
    late = torch.stack([run.explore(seen)[1] for _ in range(20)])
    assert (early != best).float().mean() == pytest.approx(2 / 3, abs=0.05)
    assert (late == best).all()


def test_policies_do_not_explore(two_episodes: Any, tmp_path: Path) -> None:
    run = loop_of(two_episodes, tmp_path)
    policy = run.policy(0)
    seen = np.random.default_rng(0).normal(size=(4, 2, 3)).astype(np.float32)
    normal = SeedNormalizer(run.moments).observations(torch.from_numpy(seen)[None])
    best = greedy_choices(run.learner.utilities(normal))[0]
    np.testing.assert_array_equal(policy.actions(seen), bins.to_actions(best, 3).numpy())
