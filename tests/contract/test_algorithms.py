"""Every registered offline algorithm keeps the contract."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.learn.training.dataset_statistics import Statistics  # noqa: E402
from swarmdata.learn.training.setup import Setup  # noqa: E402
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve  # noqa: E402
from swarmdata.testing.algorithm_contract import check_algorithm  # noqa: E402
from swarmdata.types import Batch, Step, no_messages  # noqa: E402

SIZES = Sizes(n_agents=3, observation=7, action=2, state=12)
BATCH, N_EPISODES = 16, 5

ACTOR_CRITIC: dict[str, Any] = {
    "actor_hidden": (32, 32),
    "critic_hidden": (32, 32),
    "bc_warmup_updates": 2,
    "n_updates": 200,
}
FLOW: dict[str, Any] = {"flow_hidden": (32, 32), "n_flow_steps": 3, "n_updates": 200}
SMALL: dict[str, dict[str, Any]] = {
    "bc": {"hidden": (32, 32), "n_updates": 200},
    "filtered_bc": {"hidden": (32, 32), "n_updates": 200},
    "bc_flow": {"hidden": (32, 32), **FLOW},
    "bc_latent": {"hidden": (32, 32), "n_updates": 200},
    "mac_flow": {
        "actor_hidden": (32, 32),
        "critic_hidden": (32, 32),
        **FLOW,
    },
    "facmac_bc": ACTOR_CRITIC,
    "iql": {"actor_hidden": (32, 32), "critic_hidden": (32, 32), "n_updates": 200},
    "omiga": {"actor_hidden": (32, 32), "critic_hidden": (32, 32), "n_updates": 200},
    "maddpg_bc": ACTOR_CRITIC,
    "maddpg_cql": {**ACTOR_CRITIC, "n_samples": 2},
    "cfcql": {**ACTOR_CRITIC, "n_samples": 4},
    "icql_qs": {**ACTOR_CRITIC, "n_samples": 4},
    "omar": {**ACTOR_CRITIC, "n_samples": 2, "n_candidates": 4},
    "vdn": {"hidden": (32, 32), "n_updates": 200},
    "qmix": {"hidden": (32, 32), "n_updates": 200, "mixer_hidden": 16},
}


def statistics() -> Statistics:
    rng = np.random.default_rng(0)
    return Statistics(
        observation_mean=rng.normal(size=SIZES.observation),
        observation_std=rng.uniform(0.5, 2, SIZES.observation),
        state_mean=rng.normal(size=SIZES.state),
        state_std=rng.uniform(0.5, 2, SIZES.state),
        return_std=2.0,
        max_return=5.0,
        own_return_std=2.0,
        own_max_return=5.0,
        return_range=400.0,
        own_return_range=400.0,
    )


def draw(seeds: Sequence[int], index: int) -> Batch:
    """What each seed sees depends on its own number only."""
    shapes = {
        "observations": (BATCH, SIZES.n_agents, SIZES.observation),
        "actions": (BATCH, SIZES.n_agents, SIZES.action),
        "rewards": (BATCH, SIZES.n_agents),
        "next_observations": (BATCH, SIZES.n_agents, SIZES.observation),
        "states": (BATCH, SIZES.state),
        "next_states": (BATCH, SIZES.state),
        "next_actions": (BATCH, SIZES.n_agents, SIZES.action),
        "log_probs": (BATCH, SIZES.n_agents),
    }
    rngs = [np.random.default_rng([seed, index]) for seed in seeds]
    columns = {
        name: np.stack([rng.uniform(-1, 1, shape) for rng in rngs]).astype(np.float32)
        for name, shape in shapes.items()
    }
    episodes = np.stack([rng.integers(N_EPISODES, size=BATCH) for rng in rngs])
    ends = np.stack([rng.uniform(size=BATCH) for rng in rngs])
    flags, cut = ends < 0.2, ends > 0.8
    mask = np.ones_like(flags)
    return Batch(
        **columns, terminations=flags, truncations=cut, mask=mask, episodes=episodes
    ).to_torch()


def step() -> Step:
    copies, rng = 5, np.random.default_rng(1)
    flags = np.zeros(copies, dtype=np.bool_)
    return Step(
        observations=rng.normal(size=(copies, SIZES.n_agents, SIZES.observation)).astype("f4"),
        states=rng.normal(size=(copies, SIZES.state)).astype("f4"),
        rewards=np.zeros((copies, SIZES.n_agents), dtype=np.float32),
        reward_terms=np.zeros((copies, SIZES.n_agents, 0), np.float32),
        terminations=flags,
        truncations=flags,
        successes=flags,
        events=np.zeros((copies, SIZES.n_agents, 4), dtype=np.uint8),
        seeds=np.arange(copies, dtype=np.uint64),
        times=np.zeros(copies, dtype=np.int64),
        layouts=np.zeros((copies, 0, 8), dtype=np.float32),
        **no_messages(copies, SIZES.n_agents),
    )


@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
def test_the_algorithm_keeps_the_contract(name: str) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL.get(name, {}))

    def build(seeds: Sequence[int]) -> Any:
        return kind(Setup(SIZES, seeds, statistics(), n_episodes=N_EPISODES), config)

    check_algorithm(build, draw, step())


@pytest.mark.parametrize(
    "changes",
    [
        {"reward": "team", "mixer": "free", "mixer_hidden": 16},
        {"noise": "own", "redraw": "episode"},
    ],
)
def test_other_ways_of_flowing_keep_the_contract(changes: dict[str, Any]) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "mac_flow")
    config = kind.Config(**SMALL["mac_flow"], **changes)

    def build(seeds: Sequence[int]) -> Any:
        return kind(Setup(SIZES, seeds, statistics()), config)

    check_algorithm(build, draw, step())


def test_own_joint_gradient_keeps_the_contract() -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "maddpg_bc")
    config = kind.Config(**SMALL["maddpg_bc"], joint_gradient="own")
    check_algorithm(lambda seeds: kind(Setup(SIZES, seeds, statistics()), config), draw, step())


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("vdn", {"regulariser": "bc", "behavior_head": "joint"}),
        ("vdn", {"regulariser": "none", "parameters": "separate"}),
        ("qmix", {"regulariser": "bcq"}),
    ],
)
def test_other_ways_of_valuing_keep_the_contract(name: str, changes: dict[str, Any]) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL[name], **changes)

    def build(seeds: Sequence[int]) -> Any:
        return kind(Setup(SIZES, seeds, statistics()), config)

    check_algorithm(build, draw, step(), n_updates=20)


def draw_windows(seeds: Sequence[int], index: int) -> Batch:
    """As `draw`, as 4 windows of 4 steps: one begins with padding, one ends with it."""
    batch = draw(seeds, index)
    values = {f.name: getattr(batch, f.name).unflatten(1, (4, 4)) for f in fields(batch)}
    values["mask"][:, 0, :1] = values["mask"][:, 1, 3:] = False
    return Batch(**values)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("bc", {}),
        ("filtered_bc", {}),
        ("iql", {}),
        ("bc_flow", {}),
        ("mac_flow", {}),
        ("mac_flow", {"noise": "own", "reward": "team", "n_updates": 20}),
        ("vdn", {"regulariser": "bc"}),
        ("vdn", {"regulariser": "cql", "parameters": "separate"}),
        ("qmix", {"regulariser": "bcq"}),
    ],
)
def test_policies_with_a_memory_keep_the_contract(name: str, changes: dict[str, Any]) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    memory = {"memory": "gru", "memory_size": 8, "burn_in": 1, "window": 3}
    config = kind.Config(**{**SMALL[name], **memory, **changes})

    def build(seeds: Sequence[int]) -> Any:
        return kind(Setup(SIZES, seeds, statistics()), config)

    check_algorithm(build, draw_windows, step(), n_updates=20)
