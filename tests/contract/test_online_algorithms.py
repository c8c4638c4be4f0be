"""Registered online algorithms keep the contract."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.registry import ONLINE_ALGORITHMS, make_env, resolve
from swarmdata.spec import TaskSpec
from swarmdata.testing.online import check_online_algorithm

SPEC = TaskSpec.parse({"horizon": 12, "team": [{"count": 3}]})

SHORT: dict[str, Any] = {
    "n_frames": 2_000,
    "n_copies": 4,
    "n_steps": 10,
    "batch_size": 32,
    "capacity": 100,  # rows are overwritten in the second round
    "margin": 160,
    "warm_up": 24,
}

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
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
    "vdn": ("vdn", {"hidden": (16,)}),
    "vdn-world": ("vdn", {"hidden": (16,), "frame": "world", "n_gradient_steps": 2}),
    "qmix": ("qmix", {"hidden": (16,), "mixer_hidden": 8}),
    "qmix-separate": ("qmix", {"hidden": (16,), "mixer_hidden": 8, "parameters": "separate"}),
}


def test_every_off_policy_algorithm_is_tried() -> None:
    assert {name for name, _ in VARIANTS.values()} == set(ONLINE_ALGORITHMS) - {"mappo"}


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_algorithm_keeps_the_contract(variant: str, tmp_path: Path) -> None:
    name, changes = VARIANTS[variant]
    kind = resolve("algorithm", ONLINE_ALGORITHMS, name)
    config = kind.Config(**SHORT, **changes)

    def build(seeds: Sequence[int], folder: Path) -> Any:
        return kind(make_env(SPEC, config.n_copies * len(seeds)), seeds, config, folder)

    step = make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))
    check_online_algorithm(build, step, tmp_path)
