"""VDN: the loop around the learner, two episodes, and learning."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from torch import Tensor  # noqa: E402

from swarmdata.learn.choices import bins  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.online_algos.collection.input_moments import SeedNormalizer  # noqa: E402
from swarmdata.online_algos.collection.value_learning import explore, greedy_choices  # noqa: E402
from swarmdata.online_algos.vdn import VDN, VDNConfig, VDNLearner  # noqa: E402
from swarmdata.types import Batch  # noqa: E402

SMALL: dict[str, Any] = {
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


def made(env: Any, folder: Path, **changes: Any) -> VDN:
    return VDN(env, [3], VDNConfig(**{**SMALL, **changes}), folder)


def test_robots_take_bins_and_the_replay_keeps_them(two_episodes: Any, tmp_path: Path) -> None:
    run = made(two_episodes, tmp_path)
    seen = torch.randn(1, 4, 2, 3)
    actions, kept = explore(run, seen)
    assert actions.shape == kept.shape == (1, 4, 2, 2)
    torch.testing.assert_close(actions, bins.bin_values(3)[kept.long()])
    run.update()
    choices = run.collector.replay.sample(run.collector.acting, 200).actions
    assert set(choices.unique().tolist()) == {0.0, 1.0, 2.0}


def test_exploration_falls_with_the_frames(two_episodes: Any, tmp_path: Path) -> None:
    run = made(two_episodes, tmp_path, final_epsilon=0.0, exploration=0.5)
    seen = torch.randn(1, 4, 2, 3)
    best = greedy_choices(run.learner.utilities(seen)).float()
    early = torch.stack([explore(run, seen)[1] for _ in range(200)])
    run.collector.frames = 200  # half of the training
    late = torch.stack([explore(run, seen)[1] for _ in range(20)])
    assert (early != best).float().mean() == pytest.approx(2 / 3, abs=0.05)
    assert (late == best).all()


def test_values_bootstrap_through_truncation_only(two_episodes: Any, tmp_path: Path) -> None:
    """An episode's rewards are 1, 2, 3; odd copies are cut off after the 3, even ones end there.

    With a discount of 0.5, the steps of ending ones are worth 2.75, 3.5 and 3. A learner
    that stopped at truncations would give odd copies the same values; one that went on in the next
    episode would make both larger.
    """
    changes = {"discount": 0.5, "hidden": (32,), "learning_rate": 1e-2, "tau": 0.1}
    run = made(two_episodes, tmp_path, n_gradient_steps=12, n_steps=800, **changes)
    for _ in range(8):
        run.update()
    batch = run.collector.normalized(run.collector._draw())
    q = run.learner.value(batch.observations, batch.states, batch.actions).detach()[:, 0]
    moments = run.collector.moments
    raw = batch.states * torch.from_numpy(moments.state_std[0]) + torch.from_numpy(
        moments.state_mean[0]
    )
    time, even = raw[..., 1].round(), raw[..., 2].round()
    for t, expected in enumerate((2.75, 3.5, 3.0)):
        assert q[(time == t) & (even == 1)].mean().item() == pytest.approx(expected, abs=0.25)
    assert q[(time == 2) & (even == 0)].mean().item() > 3.3


def test_discrete_actions_are_one_dimension_of_choices() -> None:
    """A learner for robots with 4 choices each, which earn by choosing their own number."""
    sizes = Sizes(n_agents=2, observation=2, action=1, state=1)
    config = VDNConfig(n_bins=4, hidden=(16,), learning_rate=1e-2, discount=0.0)
    learner = VDNLearner(sizes, [0, 1], config)
    generator = torch.Generator().manual_seed(0)
    seen = torch.eye(2).expand(2, 64, 2, 2)
    for _ in range(200):
        choices = torch.randint(4, (2, 64, 2, 1), generator=generator)
        rewards = (choices[..., 0] == torch.arange(2)).float()
        learner.update(one_step(seen, choices, rewards))
    assert learner.utilities(seen).shape == (2, 1, 64, 2, 1, 4)
    assert (greedy_choices(learner.utilities(seen))[..., 0] == torch.arange(2)).all()


def one_step(seen: Tensor, choices: Tensor, rewards: Tensor) -> Batch:
    """Transitions that end."""
    states = torch.zeros(*seen.shape[:2], 1)
    over = torch.ones(seen.shape[:2], dtype=torch.bool)
    return Batch(seen, choices, rewards, seen, states, states, over, ~over, over)


def test_policies_do_not_explore(two_episodes: Any, tmp_path: Path) -> None:
    run = made(two_episodes, tmp_path)
    policy = run.policy(0)
    seen = np.random.default_rng(0).normal(size=(4, 2, 3)).astype(np.float32)
    normal = SeedNormalizer(run.collector.moments).observations(torch.from_numpy(seen)[None])
    best = greedy_choices(run.learner.utilities(normal))[0]
    np.testing.assert_array_equal(policy.actions(seen), bins.to_actions(best, 3).numpy())


@pytest.mark.learns
@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_it_learns_to_reach_goals(
    easy_success: Callable[[Any, Any], float], parameters: Any
) -> None:
    """Within 15 s of one core."""
    config = VDNConfig(n_steps=130_000, parameters=parameters)
    assert easy_success(VDN, config) > 0.7
