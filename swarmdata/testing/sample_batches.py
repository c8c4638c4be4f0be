"""What an algorithm gets when its contract is checked: a setup, batches and a step, all random."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmdata.numerics.event_costs import COSTS
from swarmdata.types import Batch, Double, Step, blank_step

if TYPE_CHECKING:
    from swarmdata.learn.networks.dataset_statistics import Statistics
    from swarmdata.learn.networks.setup import Setup

N_AGENTS, N_OBSERVATION, N_ACTION, N_STATE = 3, 7, 2, 12
BATCH, N_EPISODES = 16, 5


def sample_setup(seeds: Sequence[int]) -> "Setup":
    """Returns what an offline algorithm of these seeds is made from; it needs torch."""
    from swarmdata.learn.networks.setup import Setup, Sizes  # noqa: PLC0415  (torch is an extra)

    sizes = Sizes(n_agents=N_AGENTS, observation=N_OBSERVATION, action=N_ACTION, state=N_STATE)
    return Setup(sizes, seeds, sample_statistics(), n_episodes=N_EPISODES)


def sample_statistics() -> "Statistics":
    """Returns statistics of data of these sizes, whose last columns never change."""
    from swarmdata.learn.networks.dataset_statistics import Statistics  # noqa: PLC0415  (torch)

    rng = np.random.default_rng(0)
    return Statistics(
        observation_mean=rng.normal(size=N_OBSERVATION),
        observation_std=_with_constant(rng.uniform(0.5, 2, N_OBSERVATION)),
        state_mean=rng.normal(size=N_STATE),
        state_std=_with_constant(rng.uniform(0.5, 2, N_STATE)),
        return_std=2.0,
        max_return=5.0,
        own_return_std=2.0,
        own_max_return=5.0,
        return_range=400.0,
        own_return_range=400.0,
    )


def _with_constant(deviations: Double) -> Double:
    return np.append(deviations[:-1], 0.0)


def sample_batch(seeds: Sequence[int], index: int) -> Batch:
    """What each seed sees depends on its own number only."""
    shapes = {
        "observations": (BATCH, N_AGENTS, N_OBSERVATION),
        "actions": (BATCH, N_AGENTS, N_ACTION),
        "rewards": (BATCH, N_AGENTS),
        "next_observations": (BATCH, N_AGENTS, N_OBSERVATION),
        "states": (BATCH, N_STATE),
        "next_states": (BATCH, N_STATE),
        "next_actions": (BATCH, N_AGENTS, N_ACTION),
        "log_probs": (BATCH, N_AGENTS),
    }
    rngs = [np.random.default_rng([seed, index]) for seed in seeds]
    columns = {
        name: np.stack([rng.uniform(-1, 1, shape) for rng in rngs]).astype(np.float32)
        for name, shape in shapes.items()
    }
    episodes = np.stack([rng.integers(N_EPISODES, size=BATCH) for rng in rngs])
    ends = np.stack([rng.uniform(size=BATCH) for rng in rngs])
    flags, cut = ends < 0.2, ends > 0.8
    contacts = [rng.uniform(size=(BATCH, N_AGENTS, len(COSTS))) < 0.1 for rng in rngs]
    return Batch(
        **columns,
        terminations=flags,
        truncations=cut,
        mask=np.ones_like(flags),
        episodes=episodes,
        costs=np.stack(contacts).astype(np.float32),
    ).to_torch()


def sample_step() -> Step:
    """Returns observations of five copies to act on."""
    copies, rng = 5, np.random.default_rng(1)
    observations = rng.normal(size=(copies, N_AGENTS, N_OBSERVATION)).astype("f4")
    states = rng.normal(size=(copies, N_STATE)).astype("f4")
    return blank_step(observations, states, seeds=np.arange(copies, dtype=np.uint64))
