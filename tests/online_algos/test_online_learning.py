"""Online algorithms learn, from what goes on after a truncation too."""

from pathlib import Path
from typing import Any

import pytest

from swarmdata.online_algos.dagger import DAgger, DAggerConfig
from swarmdata.online_algos.maddpg import MADDPG, MADDPGConfig
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.online_algos.qmix import QMIX, QMIXConfig
from swarmdata.online_algos.vdn import VDN, VDNConfig
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec

SMALL: dict[str, Any] = {
    "n_steps": 800, "n_copies": 4, "rollout_steps": 10, "n_gradient_steps": 12, "batch_size": 64,
    "capacity": 200, "margin": 80, "warmup_transitions": 0, "frame": "world", "discount": 0.5,
    "tau": 0.1,
}  # fmt: skip


def values_of(run: Any) -> tuple[Any, Any]:
    """Values of a batch from the replay, [B], and its states as recorded, [B, S]."""
    batch = run.draw()
    if isinstance(run, MADDPG):
        x = run.learner.critics.view(batch.states, batch.observations)
        return run.learner.critics.q(x, batch.actions).detach()[0, 0].mean(-1), batch.states[0]
    seen = run.normalized(batch)
    return run.learner.value(seen.observations, seen.states, seen.actions)[0, 0], batch.states[0]


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (VDN, {"hidden": (32,), "learning_rate": 1e-2, "n_bins": 3}),
        pytest.param(  # targets are those of VDN
            QMIX,
            {
                "hidden": (16,), "learning_rate": 1e-2, "n_bins": 3, "mixer_hidden": 16,
                "mixer_embedding": 8,
            },
            marks=pytest.mark.slow,
        ),
        pytest.param(
            MADDPG,
            {
                "actor_hidden": (16,), "critic_hidden": (32,), "critic_learning_rate": 1e-2,
                "policy_delay": 1, "max_grad_norm": None,
            },
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_values_bootstrap_through_truncation_only(
    kind: Any, settings: dict[str, Any], two_episodes: Any, tmp_path: Path
) -> None:
    """An episode's rewards are 1, 2, 3; odd copies are cut off after the 3, even ones end there.

    With a discount of 0.5, the steps of ending ones are worth 2.75, 3.5 and 3. A learner
    that stopped at truncations would give odd copies the same values; one that went on in the next
    episode would make both larger.
    """
    run = kind(two_episodes, [3], kind.Config(**SMALL, **settings), tmp_path)
    for _ in range(6):
        run.update()
    q, states = values_of(run)
    time, even = states[:, 1], states[:, 2]
    for t, expected in enumerate((2.75, 3.5, 3.0)):
        assert q[(time == t) & (even == 1)].mean().item() == pytest.approx(expected, abs=0.25)
    assert q[(time == 2) & (even == 0)].mean().item() > 3.3


NOTHING = {"circles": 1, "boxes": 0, "corners": 0, "pockets": 0}
EASY, PAIR = preset("coop_nav-easy"), TaskSpec.parse({"obstacles": NOTHING, "team": [{"count": 2}]})


@pytest.mark.learns
@pytest.mark.parametrize(
    ("kind", "spec", "config"),
    [
        (VDN, EASY, VDNConfig(n_steps=130_000)),
        (VDN, EASY, VDNConfig(n_steps=130_000, parameters="separate")),
        (QMIX, EASY, QMIXConfig(n_steps=130_000)),
        (MADDPG, EASY, MADDPGConfig(n_steps=60_000)),
        (MADDPG, EASY, MADDPGConfig(n_steps=60_000, corrections="none")),
        (DAgger, EASY, DAggerConfig(n_steps=65_536, hidden=32)),
        (MAPPO, PAIR, MAPPOConfig(n_steps=400_000, hidden=32)),
        (MAPPO, PAIR, MAPPOConfig(n_steps=200_000, hidden=32, memory="gru", memory_size=16)),
    ],
)
def test_robots_learn_to_reach_their_goals(
    kind: Any, spec: TaskSpec, config: Any, tmp_path: Path
) -> None:
    """Within 15 s of one core off policy."""
    seeds, least = ((0, 1), 0.8) if kind is MAPPO else ((0,), 0.7)
    run = kind(make_env(spec, config.n_copies * len(seeds)), seeds, config, tmp_path)
    while run.frames < config.n_steps:
        run.update()
    for seed in seeds:
        result = evaluate(run.policy(seed), spec, n_episodes=64, progress=False)
        assert result.metrics["success"].mean() > least
