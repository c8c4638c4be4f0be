"""MAPPO: advantages and the clipped objective by hand, noise, parameters, and learning."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import Normal
from torch.nn.functional import smooth_l1_loss

from swarmdata.errors import SpecError
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.torch_policy import Memoryless
from swarmdata.online_algos.actors.sample_rows import sample_segments
from swarmdata.online_algos.mappo import (
    MAPPO,
    MAPPOConfig,
    clipped_losses,
    generalized_advantages,
    normalized,
    value_losses,
)
from swarmdata.online_algos.ppo.initial_weights import StartConfig
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step
from tests.support.pairs import slow

STD, CLIP = 0.4, 0.2
SMALL = MAPPOConfig(n_steps=1024, n_copies=4, rollout_steps=16, hidden=16, minibatch=64)


def build(seeds: Sequence[int] = (0,), config: MAPPOConfig = SMALL) -> MAPPO:
    return MAPPO(make_env(TaskSpec(), config.n_copies * len(seeds)), seeds, config)


def test_the_shaping_knows_the_progress_of_training() -> None:
    run = build()
    progress = []
    for _ in range(3):
        run.update()
        progress.append(run.env.progress)
    each = SMALL.rollout_steps * SMALL.n_copies / SMALL.n_steps
    np.testing.assert_allclose(progress, [0.0, each, 2 * each])


def current_means(run: MAPPO) -> torch.Tensor:
    observations = run.worlds.observations(run.worlds.current_step)
    return run.actors.means(run.actors.inputs(observations))


def played_noise(correlation: float, horizon: int) -> Float:
    """Noise of standard deviation 0.3 in the actions of one rollout, [T, N A E]."""
    config = replace(
        SMALL, n_copies=32, rollout_steps=40, std=0.3, final_std=0.3, noise_correlation=correlation
    )
    run = MAPPO(make_env(TaskSpec(horizon=horizon), 32), (0,), config)
    advance, played = run.worlds.advance, []

    def spy(actions: Float) -> Step:
        means = current_means(run)
        played.append((actions - means.numpy()).ravel())
        return advance(actions)

    run.worlds.advance = spy  # type: ignore[method-assign]
    run.update()
    return np.stack(played)


@pytest.mark.parametrize("correlation", [0.9, *slow(0.0)])
def test_noise_has_the_correlation_of_the_config(correlation: float) -> None:
    noise = played_noise(correlation, horizon=100)[20:]
    np.testing.assert_allclose(noise.std(), 0.3, rtol=0.1)
    measured = (noise[1:] * noise[:-1]).mean() / noise.var()
    np.testing.assert_allclose(measured, correlation, atol=0.05)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_actions_have_the_probability_that_is_learned_from(correlation: float) -> None:
    config = replace(SMALL, noise_correlation=correlation, n_epochs=1, minibatch=1 << 20)
    run = build(config=config)
    run.update()  # of the critic only
    losses = run.update()  # one step, whose losses are of the actors that acted
    np.testing.assert_allclose(losses["kl"], 0.0, atol=1e-5)
    np.testing.assert_allclose(losses["policy"], 0.0, atol=1e-4)  # advantages have mean 0


def test_no_noise_is_carried_over_to_the_next_episode() -> None:
    noise = played_noise(0.9, horizon=10)
    new = 0.3 * np.sqrt(1 - 0.9**2)
    np.testing.assert_allclose(noise[::10].std(1), new, rtol=0.2)
    assert (noise[9::10].std(1) > 1.5 * new).all()


def test_the_critic_alone_learns_during_its_warm_up() -> None:
    run = build(config=replace(SMALL, critic_warmup_fraction=0.5))
    actor, critic = run.actors.network.flat.clone(), run.critic.network.flat.clone()
    losses = run.update()
    assert (run.actors.network.flat == actor).all()
    assert not (run.critic.network.flat == critic).all()
    assert losses["policy"].isnan().all()
    for _ in range(9):
        losses = run.update()
    assert not (run.actors.network.flat == actor).all()
    assert losses["policy"].isfinite().all()


def test_separate_parameters_give_each_robot_an_actor_of_its_own() -> None:
    run = build((0, 1), replace(SMALL, parameters="separate"))
    assert len(run.actors.network.flat) == 8
    own = run.actors.inputs(run.worlds.observations(run.worlds.current_step))
    before = run.actors.means(own)
    run.actors.network.flat[5] = 0.0  # seed 1, robot 1
    after = run.actors.means(own)
    changed = (before != after).any(-1).any(1)
    np.testing.assert_array_equal(changed, [[False] * 4, [False, True, False, False]])
    policy = run.policy(1)
    step = run.worlds.current_step
    seen = run.actors.means(own)[1].numpy().clip(-1, 1)
    frame = run.worlds.frame
    assert frame is not None
    group = step.observations[4:]
    wanted = frame.to_world(group, seen).clip(-1, 1)
    assert isinstance(policy, Memoryless)
    np.testing.assert_allclose(policy.actions(group), wanted, atol=1e-5)
    run.update()


def advantages_of(terminated: bool, cut: bool) -> np.ndarray:
    """Two steps of one copy and one robot; the first step may end an episode."""
    rewards = np.array([1.0, 2.0], np.float32).reshape(2, 1, 1)
    values = np.array([10.0, 20.0], np.float32).reshape(2, 1, 1)
    next_values = np.array([7.0, 30.0], np.float32).reshape(2, 1, 1)  # 7: the episode's last state
    terminations = np.array([[terminated], [False]])
    ended = np.array([[terminated or cut], [False]])
    found = generalized_advantages(rewards, values, next_values, terminations, ended, 0.5, 0.5)
    return found[:, 0, 0]


@pytest.mark.parametrize(
    ("terminated", "cut", "wanted"),
    [
        (False, False, [1 + 0.5 * 7 - 10 + 0.25 * -3, -3]),  # the second step's -3 flows back
        (False, True, [1 + 0.5 * 7 - 10, -3]),  # the bootstrap goes on, nothing crosses the end
        (True, False, [1 - 10, -3]),
    ],
)
def test_advantages_by_hand(terminated: bool, cut: bool, wanted: list[float]) -> None:
    np.testing.assert_allclose(advantages_of(terminated, cut), wanted)


def test_advantages_are_normalized_for_each_seed() -> None:
    values = np.random.default_rng(0).normal(size=(5, 2, 3, 4)).astype(np.float32)
    values[:, 1] = 7 * values[:, 1] + 3
    found = normalized(values)
    np.testing.assert_allclose(found.mean((0, 2, 3)), 0, atol=1e-6)
    np.testing.assert_allclose(found.std((0, 2, 3)), 1, atol=1e-5)


def log_probs(means: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
    """Without the constant, as `clipped_losses` takes them."""
    full: torch.Tensor = Normal(means, STD).log_prob(actions).sum(-1)  # type: ignore[no-untyped-call]
    return full + actions.shape[-1] * 0.5 * math.log(2 * math.pi)


def clip_samples(seed: int) -> tuple[torch.Tensor, ...]:
    """Means, actions, old log-probabilities and advantages of 3 networks."""
    g = torch.Generator().manual_seed(seed)
    old = torch.randn(3, 64, 2, generator=g, dtype=torch.float64)
    actions = old + STD * torch.randn(old.shape, generator=g, dtype=torch.float64)
    means = old + 0.1 * torch.randn(old.shape, generator=g, dtype=torch.float64)
    advantages = torch.randn(3, 64, generator=g, dtype=torch.float64)
    return means.requires_grad_(), actions, log_probs(old, actions), advantages


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_losses_are_those_of_the_equation(seed: int) -> None:
    means, actions, old, advantages = clip_samples(seed)
    losses, kl = clipped_losses(means, actions, old, advantages, std=STD, clip=CLIP)
    ratio = (log_probs(means, actions) - old).exp()
    plain, bounded = ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages
    expected = -torch.minimum(plain, bounded)
    torch.testing.assert_close(losses, expected)
    slopes = [torch.autograd.grad(each.sum(), means)[0] for each in (losses, expected)]
    torch.testing.assert_close(*slopes)
    assert (kl >= 0).all()
    assert not kl.requires_grad


def test_value_losses_are_the_larger_of_two() -> None:
    g = torch.Generator().manual_seed(0)
    values, returns, old = torch.randn(3, 2, 64, generator=g, dtype=torch.float64)
    values.requires_grad_()
    plain = value_losses(values, returns, old, None)
    torch.testing.assert_close(plain, smooth_l1_loss(values, returns, reduction="none"))
    near = old + (values - old).clamp(-CLIP, CLIP)
    bounded = smooth_l1_loss(near, returns, reduction="none")
    found, expected = value_losses(values, returns, old, CLIP), torch.maximum(plain, bounded)
    torch.testing.assert_close(found, expected)
    (slope,) = torch.autograd.grad(found.sum(), values)
    torch.testing.assert_close(slope, torch.autograd.grad(expected.sum(), values)[0])


@pytest.mark.slow
@pytest.mark.parametrize("parameters", ["shared", *slow("separate")])
def test_a_bonus_on_entropy_widens_the_actions(parameters: Parameters) -> None:
    changes: dict[str, Any] = {"learned_std": True, "parameters": parameters, "n_epochs": 8}
    config = replace(SMALL, learning_rate=1e-2, std=0.3, **changes)
    spread = []
    for weight in (0.0, 10.0):
        run = build((0, 1), replace(config, entropy_weight=weight))
        stds = [run.update()["std"] for _ in range(4)]
        torch.testing.assert_close(stds[0], torch.full((2,), 0.3))
        spread.append(stds[-1])
        saved = run.state_dict()
        other = build((0, 1), replace(config, entropy_weight=weight))
        other.load_state_dict(saved)
        restored = other.state_dict()
        for name in ("actor", "deviation", "deviation_adam.exp_avg"):
            assert torch.equal(restored[name], saved[name]), name
    assert (spread[1] > 1.1 * spread[0]).all()


MEMORY = replace(SMALL, memory="gru", memory_size=8, window=8, final_std=SMALL.std)


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_segments_are_remembered_as_they_were_played(parameters: Parameters) -> None:
    """The ratios are 1 before the first update, also where episodes end inside a segment."""
    config = replace(MEMORY, parameters=parameters)
    run = MAPPO(make_env(TaskSpec(horizon=11), 8), (0, 1), config)
    for network in (run.actors.network, run.critic.network):  # means that differ from step to step
        network.flat.normal_(0, 0.3, generator=torch.Generator().manual_seed(0))
    for _ in range(2):  # the second rollout begins with what is remembered of the first
        r = run._collect()
    assert r.ended[2:7].any()
    assert np.abs(r.memories[0]).max() > 0
    means = run.actors.again(*run.actors.seen(r.actor_inputs, r.memories, r.ended))
    actions, old = (
        sample_segments(torch.from_numpy(x), parameters, 8).flatten(1, 2)
        for x in (r.actions, r.log_probs)
    )
    losses, kl = clipped_losses(
        means, actions, old, torch.ones_like(old), std=run.innovation_std, clip=0.2
    )
    torch.testing.assert_close(losses, -torch.ones_like(old), rtol=1e-3, atol=1e-3)
    assert kl.max() < 1e-4


def test_an_episode_begins_with_an_empty_memory() -> None:
    run = MAPPO(make_env(TaskSpec(horizon=11), 4), (0,), MEMORY)
    r = run._collect()
    ended = r.ended[:-1]
    assert ended.any()
    assert not r.memories[1:][ended].any()
    assert (np.abs(r.memories[1:][~ended]).max(-1) > 0).all()
    run.restart_worlds()
    assert not run._memory.any()


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_the_policy_remembers_as_in_training(parameters: Parameters) -> None:
    run = MAPPO(make_env(TaskSpec(), 4), (0,), replace(MEMORY, parameters=parameters))
    run.update()
    policy, memory = run.policy(0), torch.zeros(1, 4, 4, 8)
    run.restart_worlds()
    policy.reset(run.worlds.current_step, np.arange(4))
    frame = run.worlds.frame
    assert frame is not None
    for _ in range(5):
        step = run.worlds.current_step
        means, memory = run.actors.act(run.actors.inputs(run.worlds.observations(step)), memory)
        taken = policy.act(step)
        wanted = frame.to_world(step.observations, means[0].clamp(-1, 1).numpy()).clip(-1, 1)
        np.testing.assert_allclose(taken, wanted, atol=1e-4)
        run.worlds.advance(means.numpy())


@pytest.mark.parametrize(
    ("config", "changes", "message"),
    [
        (SMALL, {"entropy_weight": 0.01}, "entropy is constant; set learned_std"),
        (MEMORY, {"window": 5}, "multiple of window"),
        (MEMORY, {"window": 1 << 20}, "expected at most a minibatch"),
        (MEMORY, {"start": StartConfig(teacher="scripted")}, "no memory"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(
    config: MAPPOConfig, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(SpecError, match=message):
        replace(config, **changes)
