"""QMIX: the mixer is trained and used, two episodes, and learning."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.online_algos.qmix import QMIX, QMIXConfig, QMIXLearner  # noqa: E402

SMALL: dict[str, Any] = {
    "n_steps": 800,
    "n_copies": 4,
    "rollout_steps": 10,
    "batch_size": 64,
    "capacity": 200,
    "margin": 80,
    "warmup_transitions": 0,
    "hidden": (16,),
    "mixer_hidden": 16,
    "mixer_embedding": 8,
    "frame": "world",
    "n_bins": 3,
}


def test_the_mixer_has_the_sizes_of_the_config() -> None:
    sizes = Sizes(n_agents=3, observation=5, action=2, state=7)
    mixer = QMIXLearner(sizes, [1, 2], QMIXConfig(mixer_embedding=4, mixer_hidden=6)).mixer
    assert len(mixer.network.flat) == 2
    assert (mixer.network.shape.inputs, mixer.network.shape.hidden) == (7 + 3 * 5, (6,))
    assert mixer(torch.zeros(2, 9, 3), torch.zeros(2, 9, 22)).shape == (2, 9)


def test_the_mixer_sees_what_the_robots_observe() -> None:
    sizes = Sizes(n_agents=2, observation=3, action=1, state=4)
    learner = QMIXLearner(sizes, [0], QMIXConfig(hidden=(4,), n_bins=3))
    with torch.no_grad():  # the robots' own values are blind
        learner.team.network.flat[...] = 0.0
    features, states = torch.randn(1, 5, 2, 3), torch.randn(1, 5, 4)
    choices = torch.zeros(1, 5, 2, 1, dtype=torch.long)
    value = learner.value(features, states, choices)
    assert not torch.allclose(learner.value(features + 1, states, choices), value)
    assert not torch.allclose(learner.value(features, states + 1, choices), value)


def test_a_round_trains_utilities_and_mixer(two_episodes: Any, tmp_path: Path) -> None:
    run = QMIX(two_episodes, [3], QMIXConfig(**SMALL), tmp_path)
    before = run.state_dict()
    run.update()
    after = run.state_dict()
    for name in ("team", "mixer", "target_team", "target_mixer"):
        assert not torch.equal(before[f"learner.{name}"], after[f"learner.{name}"]), name


def test_values_bootstrap_through_truncation_only(two_episodes: Any, tmp_path: Path) -> None:
    """As in the test of VDN: rewards 1, 2, 3; even copies end after the 3, odd ones are cut."""
    changes = {"discount": 0.5, "learning_rate": 1e-2, "tau": 0.1, "n_gradient_steps": 12}
    run = QMIX(two_episodes, [3], QMIXConfig(**{**SMALL, **changes}), tmp_path)
    for _ in range(8):
        run.update()
    collector = run.collector
    batch = collector.normalized(collector._draw())
    q = run.learner.value(batch.observations, batch.states, batch.actions).detach()[:, 0]
    mean, std = (torch.from_numpy(m[0]) for m in collector.moments[2:])
    raw = (batch.states * std + mean).round()
    time, even = raw[..., 1], raw[..., 2]
    for t, expected in enumerate((2.75, 3.5, 3.0)):
        assert q[(time == t) & (even == 1)].mean().item() == pytest.approx(expected, abs=0.25)
    assert q[(time == 2) & (even == 0)].mean().item() > 3.3


@pytest.mark.learns
def test_it_learns_to_reach_goals(easy_success: Callable[[Any, Any], float]) -> None:
    """Within 15 s of one core."""
    assert easy_success(QMIX, QMIXConfig(n_steps=130_000)) > 0.7
