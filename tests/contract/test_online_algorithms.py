"""Registered online algorithms keep the contract."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.shaping.shaped_env import ShapingConfig
from swarmdata.registry.components import ONLINE_ALGORITHMS, make_env, resolve
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.online_contract import check_online_algorithm
from tests.support.pairs import slow

SPEC = TaskSpec.parse({"horizon": 12, "team": [{"count": 3}]})

SHORT: dict[str, Any] = {"n_steps": 2_000, "n_copies": 4, "rollout_steps": 10}

REPLAY: dict[str, Any] = {
    "batch_size": 32,
    "capacity": 100,  # rows are overwritten in the second round
    "margin": 160,
    "warmup_transitions": 24,
}

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "mappo": ("mappo", {"hidden": 16, "minibatch": 64}),
    "mappo-separate-memory": (
        "mappo",
        {
            "hidden": 16,
            "minibatch": 20,
            "parameters": "separate",
            "memory": "gru",
            "memory_size": 8,
            "window": 2,
        },
    ),
    "mappo-shaped": (
        "mappo",
        {
            "hidden": 16,
            "minibatch": 64,
            "frame": "world",
            "shaping": ShapingConfig(
                contact_ramp=(-1.0, 0.0), keep_right=0.3, reward_weights=("proximity=2",)
            ),
        },
    ),
    "maddpg": ("maddpg", {"actor_hidden": (16,), "critic_hidden": (16,)}),
    "maddpg-original": (
        "maddpg",
        {
            "actor_hidden": (16,),
            "critic_hidden": (16,),
            "corrections": "none",
            "joint_gradient": "own",
            "parameters": "separate",
        },
    ),
    "vdn-world": ("vdn", {"hidden": (16,), "frame": "world", "n_gradient_steps": 2}),
    "qmix": ("qmix", {"hidden": (16,), "mixer_hidden": 8}),
    "dagger": ("dagger", {"hidden": 16, "minibatch": 64}),
    "dagger-avoiding": (
        "dagger",
        {"hidden": 16, "minibatch": 64, "parameters": "separate", "avoidance": True},
    ),
    "qmix-separate": ("qmix", {"hidden": (16,), "mixer_hidden": 8, "parameters": "separate"}),
}

OF_EACH = ("mappo", "maddpg", "vdn-world", "qmix", "dagger")
"""A variant of each algorithm."""
OTHERS = [name for name in VARIANTS if name not in OF_EACH]


def test_every_online_algorithm_is_tried() -> None:
    assert sorted(VARIANTS[each][0] for each in OF_EACH) == sorted(ONLINE_ALGORITHMS)


@pytest.mark.parametrize("name", ONLINE_ALGORITHMS)
def test_every_online_algorithm_can_start_from_an_offline_run(name: str) -> None:
    kind = resolve("algorithm", ONLINE_ALGORITHMS, name)
    assert callable(kind.settings_of)
    assert callable(kind.start_from)


@pytest.mark.parametrize("variant", [*OF_EACH, *slow(*OTHERS)])
def test_the_algorithm_keeps_the_contract(variant: str, tmp_path: Path) -> None:
    name, changes = VARIANTS[variant]
    kind = resolve("algorithm", ONLINE_ALGORITHMS, name)
    replay = {} if name in ("mappo", "dagger") else REPLAY
    config = kind.Config(**SHORT, **replay, **changes)

    def build(seeds: Sequence[int], folder: Path) -> Any:
        return kind(make_env(SPEC, config.n_copies * len(seeds)), seeds, config, folder)

    step = make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))
    check_online_algorithm(build, step, tmp_path)


@pytest.mark.slow
def test_a_run_that_began_with_a_clone_keeps_the_contract(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swarmdata.online_algos.imitation.teacher_cloning import CloneConfig
    from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
    from swarmdata.online_algos.ppo import initial_weights

    short = partial(CloneConfig, rollout_steps=6, n_passes=1, final_passes=1, minibatch=32)
    monkeypatch.setattr(initial_weights, "CloneConfig", short)
    start = initial_weights.StartConfig(teacher="scripted", clone_rounds=2)
    config = MAPPOConfig(**SHORT, hidden=16, minibatch=64, start=start)

    def build(seeds: Sequence[int], folder: Path) -> Any:
        run = MAPPO(make_env(SPEC, config.n_copies * len(seeds)), seeds, config, folder)
        run.prepare()
        return run

    step = make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))
    check_online_algorithm(build, step, tmp_path)


def test_policies_that_a_run_could_not_keep_break_the_contract(tmp_path: Path) -> None:
    """Any policy can act, but training would stop at the first that is written to a file."""
    from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig

    class Wrapped:
        def __init__(self, policy: Any) -> None:
            self.reset, self.act, self.log_probs = policy.reset, policy.act, policy.log_probs

    class Wrapping(MAPPO):
        def policy(self, index: int) -> Any:
            return Wrapped(super().policy(index))

    config = MAPPOConfig(**SHORT, hidden=16, minibatch=64)

    def build(seeds: Sequence[int], folder: Path) -> Any:
        return Wrapping(make_env(SPEC, config.n_copies * len(seeds)), seeds, config, folder)

    step = make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))
    with pytest.raises(AssertionError, match=r"could not keep its policies: .* class Wrapped"):
        check_online_algorithm(build, step, tmp_path)
