"""Episodes made of arrays, without messages, events or obstacles, or of the states of others."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.registry.components import make_env, make_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.origins import Origin
from swarmdata.specs.recipe import PolicySource, Recipe, Splits
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.assembly import assemble
from swarmdata.store.episode_order import merge_order
from swarmdata.testing.synthetic import write_streams
from swarmdata.types import STATE_FIELDS, STEP_FIELDS, Episode, Float, no_messages


def made_episode(
    observations: Any,
    states: Any,
    actions: Any,
    rewards: Any,
    *,
    ends: bool,
    seed: int = 0,
    policy: int = 0,
) -> Episode:
    """Returns an episode whose last step is a termination if it `ends`, else a truncation.

    Args:
        observations: [T + 1, N, O].
        states: [T + 1, S].
        actions: [T, N, A].
        rewards: [T, N].
        ends: whether the task ended.
        seed: of the episode.
        policy: number of the policy that acted.
    """
    length, n_agents = np.shape(rewards)
    last = np.arange(length) == length - 1
    return Episode(
        observations=np.asarray(observations, np.float32),
        states=np.asarray(states, np.float32),
        actions=np.asarray(actions, np.float32),
        log_probs=np.zeros((length, n_agents), np.float32),
        rewards=np.asarray(rewards, np.float32),
        terminations=last & ends,
        truncations=last & (not ends),
        events=np.zeros((length, n_agents, 4), np.uint8),
        **no_messages(length + 1, n_agents),
        layout=np.zeros((0, 8), np.float32),
        seed=seed,
        policy=policy,
        end_reason=0 if ends else 2,
    )


def left_early(episode: Episode) -> Episode:
    """The episode, of which agent 0 terminates in the first step, and the others with the team."""
    length, n_agents = episode.rewards.shape
    alive = np.repeat(np.arange(length + 1)[:, None] < length, n_agents, axis=1)
    alive[1:, 0] = False
    leaves: dict[str, Any] = {
        f"agent_{name}": np.repeat(getattr(episode, name)[:, None], n_agents, axis=1)
        for name in ("terminations", "truncations")
    }
    for flags in leaves.values():
        flags[:, 0] = False
    leaves["agent_terminations"][0, 0] = True
    acts = alive[:-1]
    absent: dict[str, Any] = {
        n: np.where(acts, getattr(episode, n), 0) for n in ("rewards", "log_probs")
    }
    actions = np.where(acts[..., None], episode.actions, 0)
    return replace(episode, alive=alive, actions=actions, **absent, **leaves)


def stored(
    folder: Path, origin: Origin, streams: Sequence[Sequence[Episode]], splits: Any = None
) -> Dataset:
    """Writes the dataset of a recipe whose policies made these streams of episodes.

    Of another origin, it has all of them, one stream after the other.
    """
    parts = write_streams(folder.parent / f"{folder.name}.parts", streams)
    order: Any = [(p, k) for p, stream in enumerate(streams) for k in range(len(stream))]
    if isinstance(origin, Recipe):
        order = merge_order(origin, [list(map(len, stream)) for stream in streams]).order
    assemble(folder, recipe=origin, parts=parts, order=order, splits=splits)
    return Dataset.open(folder)


def cut(episode: Episode, states: Float) -> Episode:
    """An episode with these states, and as many rows of the other fields."""
    rows = {name: getattr(episode, name)[: len(states)] for name in STATE_FIELDS}
    rows |= {
        name: getattr(episode, name)[: len(states) - 1] for name in (*STEP_FIELDS, "reward_terms")
    }
    return replace(episode, **rows | {"states": states})


def played(spec: TaskSpec, seed: int = 3, policy: str = "scripted") -> Episode:
    """The episode of a seed, as a named policy plays it."""
    return play(spec, 1, policy, seed)[0]


def play(
    spec: TaskSpec, n: int, policy: str = "straight", first: int = 0, index: int = 0
) -> list[Episode]:
    """The episodes of n seeds from the first one on, as a named policy plays them."""
    seeds = np.arange(first, first + n, dtype=np.uint64)
    env = make_env(spec, min(n, 4))
    return list(rollout(env, make_policy(policy, spec), seeds, policy_index=index))


def record(folder: Path, spec: TaskSpec, n: int, *policies: str, block: int) -> Dataset:
    """A dataset of n episodes of each named policy, of which it has nearly all."""
    streams = [play(spec, n, name, 100 * k, k) for k, name in enumerate(policies)]
    recipe = Recipe(
        id=f"{spec.task}-test-v0",
        tier="test",
        spec=spec,
        policies=tuple(PolicySource(label=name, name=name) for name in policies),
        n_steps=(len(policies) + 1) * min(sum(map(len, each)) for each in streams) // 2,
        splits=Splits(block=block),
    )
    return stored(folder, recipe, streams)
