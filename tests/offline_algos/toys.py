"""Tiny networks, batches and training loops for tests of algorithms."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import islice
from typing import Any, TypeVar

import numpy as np
import torch

from swarmdata.interfaces import Policy
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.learn.policies.torch_policy import Memoryless
from swarmdata.learn.training.trainer import sampler_of
from swarmdata.types import Batch, Episode, Float, Step, blank_step
from tests.offline_algos.conftest import play
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset

Algorithm = TypeVar("Algorithm")

SIZES = Sizes(n_agents=2, observation=3, action=2, state=4)
TINY = {
    "actor_hidden": (16,),
    "critic_hidden": (16,),
    "bc_warmup_share": 0.0,
    "policy_delay": 1,
    "n_samples": 3,
}
"""Settings that `made` gives to algorithms that have them."""

SEEDS = (0, 1)
SMALL = {
    "hidden": (32, 32),
    "actor_hidden": (32, 32),
    "critic_hidden": (32, 32),
    "discount": 0.9,
    "batch_size": 128,
    "learning_rate": 3e-3,
    "actor_learning_rate": 3e-3,
    "temperature": 0.1,
    "threshold": 0.3,
}
"""Settings that `trained` gives to algorithms that have them."""


def made(
    kind: type[Algorithm],
    n_seeds: int = 1,
    *,
    changes: dict[str, float] | None = None,
    **config: Any,
) -> Algorithm:
    """Returns an untrained algorithm of `SIZES`, with `changes` to its statistics."""
    build: Any = kind
    settings = configured(build, TINY, config)
    return build(Setup(SIZES, range(n_seeds), statistics(**(changes or {}))), settings)


def trained(
    kind: type[Algorithm],
    data: MemoryDataset,
    n_updates: int,
    *,
    seeds: Sequence[int] = SEEDS,
    **config: Any,
) -> tuple[Algorithm, list[dict[str, float]]]:
    """Returns the algorithm and its losses, means over seeds, of every update."""
    build: Any = kind
    settings = configured(build, SMALL, {"n_updates": n_updates, **config})
    stream = batches(data, settings, seeds)
    measured = Statistics.measure(data, settings.discount)
    setup = Setup(Sizes.of(next(stream)), seeds, measured, n_episodes=len(data))
    algorithm = build(setup, settings)
    losses = [
        {name: loss.mean().item() for name, loss in algorithm.update(batch).items()}
        for batch in islice(stream, n_updates)
    ]
    return algorithm, losses


def configured(kind: Any, defaults: dict[str, Any], config: dict[str, Any]) -> Any:
    """Returns a config of an algorithm: those defaults that it has a field for, and `config`."""
    names = {field.name for field in fields(kind.Config)}
    known = {name: value for name, value in defaults.items() if name in names}
    return kind.Config(**{**known, **config})


def batches(data: MemoryDataset, settings: Any, seeds: Sequence[int]) -> Iterator[Batch]:
    """Yields batches [K, B, ...] without end, the rows of each seed by a sampler of its own."""
    samplers: Sequence[Any] = [sampler_of(data, settings, seed) for seed in seeds]
    while True:
        yield samplers[0].gather(np.stack([s.draw() for s in samplers])).to_torch()


def statistics(**changes: float) -> Statistics:
    """Moments of 0 and 1 for data of `SIZES`, rewards that need no scale, no bound of values."""
    values = dict.fromkeys(("return_std", "own_return_std"), 1.0)
    values |= dict.fromkeys(("max_return", "own_max_return"), 1e9)
    values |= {"return_range": 1000.0, "own_return_range": 1000.0, **changes}
    return Statistics(
        observation_mean=np.zeros(3),
        observation_std=np.ones(3),
        state_mean=np.zeros(4),
        state_std=np.ones(4),
        **values,
    )


def random_batch(n_seeds: int = 1, size: int = 32) -> Batch:
    """The same numbers at every call, [K, B, ...]; every row ends, 3 in 10 by a termination."""
    torch.manual_seed(0)
    flags = torch.rand(n_seeds, size) < 0.3
    return Batch(
        observations=torch.randn(n_seeds, size, 2, 3),
        actions=torch.rand(n_seeds, size, 2, 2) * 2 - 1,
        rewards=torch.randn(n_seeds, size, 2),
        next_observations=torch.randn(n_seeds, size, 2, 3),
        states=torch.randn(n_seeds, size, 4),
        next_states=torch.randn(n_seeds, size, 4),
        terminations=flags,
        truncations=~flags,
        mask=torch.ones_like(flags),
        next_actions=torch.rand(n_seeds, size, 2, 2) * 2 - 1,
        log_probs=torch.zeros(n_seeds, size, 2),
        costs=(torch.rand(n_seeds, size, 2, 2) < 0.1).float(),
    )


def seed_of(batch: Batch, seed: int) -> Batch:
    """Returns the rows of one seed, [1, B, ...], of a batch [K, B, ...]."""
    values = {field.name: getattr(batch, field.name) for field in fields(batch)}
    return Batch(**{k: None if v is None else v[seed : seed + 1] for k, v in values.items()})


def actions_of(policy: Policy, observations: Float) -> Float:
    """Returns the actions of a policy without memory."""
    assert isinstance(policy, Memoryless)
    return policy.actions(observations)


def step_of(copies: int = 6, times: int = 0) -> Step:
    """Random observations of `SIZES`, the same at every call; episodes have seeds 0, 1, ..."""
    shape = (copies, SIZES.n_agents, SIZES.observation)
    observations = np.random.default_rng(1).normal(size=shape).astype(np.float32)
    return blank_step(
        observations, np.zeros((copies, SIZES.state), np.float32),
        seeds=np.arange(copies, dtype=np.uint64), times=np.full(copies, times),
    )  # fmt: skip


def set_bias(network: StackedMLP, row: int, value: float) -> None:
    """Makes one critic the constant function `value`."""
    network.flat[row] = 0.0
    bias = network.layers[-1].bias
    with torch.no_grad():
        bias[row] = value


def two_episodes() -> MemoryDataset:
    """One that terminates, one that is truncated; states tell the episode and the time."""

    def episode(number: int, *, cut: bool) -> Episode:
        states = np.zeros((3, 4))
        states[:, 0], states[:, 1] = number, np.arange(3)
        rewards = [[1.0, 3.0], [5.0, 7.0]]  # of the team: 2, 6
        return made_episode(
            np.zeros((3, 2, 3)), states, np.zeros((2, 2, 2)), rewards, ends=not cut, seed=number
        )

    return MemoryDataset([episode(1, cut=False), episode(2, cut=True)])


def same_side(n_episodes: int = 300, length: int = 8) -> MemoryDataset:
    """Two conventions: in an episode both robots go right at every step, or both left.

    The side is the sign of the second component, 0.8 in size. Nothing that the robots observe tells
    it. The first component follows what a robot observes. Going to the same side is worth 1.
    """
    rng = np.random.default_rng(0)
    return MemoryDataset([
        _one_side(rng, 1.0 if number % 2 else -1.0, number, length) for number in range(n_episodes)
    ])  # fmt: skip


def _one_side(rng: np.random.Generator, side: float, number: int, length: int) -> Episode:
    observations = rng.normal(size=(length + 1, 2, 3)).astype(np.float32)
    actions = np.zeros((length, 2, 2))
    actions[..., 0] = observations[:-1, :, 0].clip(-0.5, 0.5)
    actions[..., 1] = 0.8 * side
    actions += rng.normal(0, 0.05, actions.shape)
    return made_episode(
        observations, rng.normal(size=(length + 1, 4)), actions.clip(-1, 1), np.ones((length, 2)),
        ends=False, seed=number,
    )  # fmt: skip


def progress_of(actions: Float, observations: Float) -> float:
    """Mean progress of one step at the dataset's observations; straight at the goal gives 0.16."""
    offsets = observations[..., 2:4]
    before = np.linalg.norm(offsets, axis=-1)
    return float((before - np.linalg.norm(offsets - 0.2 * actions, axis=-1)).mean())


def sign_at_the_start(n_episodes: int, seed: int) -> MemoryDataset:
    """Robots see a sign in the first step only, and drive by it in all 12 steps; states tell it."""
    rng = np.random.default_rng(seed)
    episodes = []
    for _ in range(n_episodes):
        episode = play(rng, good=True, cut=True)
        signs = rng.choice([-1.0, 1.0], size=(2, 1))
        observations = rng.normal(size=episode.observations.shape).astype(np.float32)
        observations[:, :, 0], observations[0, :, 0] = 0.0, signs[:, 0]
        states = rng.normal(size=episode.states.shape).astype(np.float32)
        states[:, :2] = signs[:, 0]
        actions = np.broadcast_to(0.8 * signs, episode.actions.shape).astype(np.float32)
        episodes.append(
            replace(
                episode,
                observations=observations,
                states=states,
                actions=actions,
                rewards=np.ones_like(episode.rewards),
            )
        )
    return MemoryDataset(episodes)


def share_by_the_sign(policy: Policy) -> float:
    """Share of robots that still drive by the sign 11 steps later; guessing makes a half."""
    fresh = sign_at_the_start(50, 1)
    observations = np.stack([episode.observations for episode in fresh], 1)  # [T + 1, E, N, O]
    steps = [step_of(50, t)._replace(observations=row) for t, row in enumerate(observations[:12])]
    policy.reset(steps[0], np.arange(50))
    for step in steps:
        actions = policy.act(step)
    return float((np.sign(actions[..., 0]) == observations[0, ..., 0]).mean())


def hinted_side(n_episodes: int = 100, length: int = 20, seed: int = 0) -> MemoryDataset:
    """In each step both robots go right, or both left; what they observe tells it in 6 of 10 cases.

    Each robot observes a sign of its own, which is that of the side with probability 0.6. The side
    is the sign of the second component, 0.8 in size. Robots that each follow their sign agree in
    52 of 100 steps.
    """
    rng = np.random.default_rng(seed)
    episodes = []
    for number in range(n_episodes):
        side = rng.choice([-1.0, 1.0], size=(length + 1, 1))
        signs = np.where(rng.random((length + 1, 2)) < 0.6, side, -side)
        observations = rng.normal(size=(length + 1, 2, 3)).astype(np.float32)
        observations[..., 0] = signs
        actions = np.zeros((length, 2, 2))
        actions[..., 1] = 0.8 * side[:-1]
        actions += rng.normal(0, 0.05, actions.shape)
        episodes.append(
            made_episode(
                observations, rng.normal(size=(length + 1, 4)), actions.clip(-1, 1),
                np.ones((length, 2)), ends=False, seed=number,
            )
        )  # fmt: skip
    return MemoryDataset(episodes)
