"""MAPPO: what its rewards, frames and parameters do, and learning."""

from collections.abc import Sequence

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from dataclasses import replace

from swarmdata.errors import SpecError
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.registry.components import make_env
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

SMALL = MAPPOConfig(n_frames=1024, n_copies=4, n_steps=16, hidden=16, minibatch=64)


def build(seeds: Sequence[int] = (0,), config: MAPPOConfig = SMALL) -> MAPPO:
    return MAPPO(make_env(TaskSpec(), config.n_copies * len(seeds)), seeds, config)


def test_contact_costs_ramp_up_and_lower_only_touching_robots() -> None:
    run = build()
    step = run.worlds.env.step(np.zeros((4, 4, 2)))
    step = step._replace(events=np.zeros_like(step.events))
    step.events[0, 1] = (1, 0, 1, 0)
    before = run.rewards(step, step)[0]
    run.frames = SMALL.n_frames
    after = run.rewards(step, step)[0]
    assert after[0, 1] < before[0, 1]
    np.testing.assert_array_equal(after[1:], before[1:])


def test_training_rewards_may_differ_from_the_task() -> None:
    run = build(config=replace(SMALL, rewards=("proximity=2", "time=0")))
    weights = run.worlds.env.spec.rules.rewards
    assert (weights.proximity, weights.time) == (2.0, 0.0)
    assert weights.success == TaskSpec().rules.rewards.success


def played_noise(memory: float, horizon: int) -> Float:
    """Noise of standard deviation 0.3 in the actions of one rollout, [T, N A E]."""
    config = replace(SMALL, n_copies=32, n_steps=40, std=0.3, final_std=0.3, noise_memory=memory)
    run = MAPPO(make_env(TaskSpec(horizon=horizon), 32), (0,), config)
    advance, played = run.worlds.advance, []

    def spy(actions: Float) -> Step:
        means = run.means(run.inputs(run.worlds.seen(run.worlds.present)))
        played.append((actions - means.numpy()).ravel())
        return advance(actions)

    run.worlds.advance = spy  # type: ignore[method-assign]
    run.update()
    return np.stack(played)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_noise_remembers_as_much_as_is_said(memory: float) -> None:
    noise = played_noise(memory, horizon=100)[20:]
    np.testing.assert_allclose(noise.std(), 0.3, rtol=0.1)
    correlation = (noise[1:] * noise[:-1]).mean() / noise.var()
    np.testing.assert_allclose(correlation, memory, atol=0.05)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_what_acted_has_the_probability_that_is_learned_from(memory: float) -> None:
    config = replace(SMALL, noise_memory=memory, n_epochs=1, minibatch=1 << 20)
    run = build(config=config)
    run.update()  # of the critic only
    losses = run.update()  # one step, whose losses are of the actors that acted
    np.testing.assert_allclose(losses["kl"], 0.0, atol=1e-5)
    np.testing.assert_allclose(losses["policy"], 0.0, atol=1e-4)  # advantages have mean 0


@pytest.mark.parametrize("memory", [1.0, -0.1, float("nan")])
def test_noise_cannot_remember_everything(memory: float) -> None:
    with pytest.raises(SpecError, match=r"noise_memory is .* below 1"):
        build(config=replace(SMALL, noise_memory=memory))


def test_no_noise_is_remembered_beyond_an_episode() -> None:
    noise = played_noise(0.9, horizon=10)
    new = 0.3 * np.sqrt(1 - 0.9**2)
    np.testing.assert_allclose(noise[::10].std(1), new, rtol=0.2)
    assert (noise[9::10].std(1) > 1.5 * new).all()


def test_the_critic_alone_learns_during_its_warm_up() -> None:
    run = build(config=replace(SMALL, critic_warmup=0.5))
    actor, critic = run.actor.flat.clone(), run.critic.flat.clone()
    losses = run.update()
    assert (run.actor.flat == actor).all()
    assert not (run.critic.flat == critic).all()
    assert losses["policy"].isnan().all()
    for _ in range(9):
        losses = run.update()
    assert not (run.actor.flat == actor).all()
    assert losses["policy"].isfinite().all()


def test_separate_parameters_give_each_robot_an_actor_of_its_own() -> None:
    run = build((0, 1), replace(SMALL, parameters="separate"))
    assert len(run.actor.flat) == 8
    own = run.inputs(run.worlds.seen(run.worlds.present))
    before = run.means(own)
    run.actor.flat[5] = 0.0  # seed 1, robot 1
    after = run.means(own)
    changed = (before != after).any(-1).any(1)
    np.testing.assert_array_equal(changed, [[False] * 4, [False, True, False, False]])
    policy = run.policy(1)
    step = run.worlds.present
    seen = run.means(own)[1].numpy().clip(-1, 1)
    frame = run.worlds.frame
    assert frame is not None
    group = step.observations[4:]
    wanted = frame.to_world(group, seen).clip(-1, 1)
    np.testing.assert_allclose(policy.actions(group), wanted, atol=1e-5)
    run.update()


def test_seeds_have_generators_and_parameters_of_their_own() -> None:
    run = build((3, 3, 4))
    run.update()
    assert (run.actor.flat[0] == run.actor.flat[1]).all()
    assert not (run.actor.flat[0] == run.actor.flat[2]).all()


@pytest.mark.learns
def test_two_robots_learn_to_reach_their_goals() -> None:
    nothing = {"circles": 1, "boxes": 0, "corners": 0, "pockets": 0}
    spec = TaskSpec.parse({"obstacles": nothing, "team": [{"count": 2}]})
    config = MAPPOConfig(n_frames=400_000, hidden=32)
    run = MAPPO(make_env(spec, 128), (0, 1), config)
    while run.frames < config.n_frames:
        run.update()
    for seed in range(2):
        result = evaluate(run.policy(seed), spec, name="mappo", n_episodes=64, progress=False)
        assert result.metrics["success"].mean() > 0.8
