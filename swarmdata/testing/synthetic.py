"""Synthetic episodes and datasets: small episodes whose values name their episode, time and agent."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from swarmdata.spec import PolicySource, Recipe, Role, Splits, TaskSpec
from swarmdata.store import Manifest, assemble, merge_order, write_part
from swarmdata.types import END_REASONS, Episode

N, S, A, M = 2, 3, 2, 4
N_FEATURES = 5


def make_episode(length: int, seed: int, policy: int = 0, n_obstacles: int = M) -> Episode:
    """Feature 0 is the seed, feature 1 the time, feature 2 the agent; the rest is noise."""
    rng = np.random.default_rng([seed, policy])
    observations = rng.normal(size=(length + 1, N, N_FEATURES)).astype(np.float32)
    observations[..., 0] = seed
    observations[..., 1] = np.arange(length + 1)[:, None]
    observations[..., 2] = np.arange(N)
    states = rng.normal(size=(length + 1, S)).astype(np.float32)
    states[:, 0] = seed
    states[:, 1] = np.arange(length + 1)
    actions = rng.uniform(-1, 1, size=(length, N, A)).astype(np.float32)
    end_reason = int(rng.integers(len(END_REASONS)))
    ends = np.arange(length) == length - 1
    horizon = END_REASONS[end_reason] == "horizon"
    events = rng.integers(0, 2, size=(length, N, 4)).astype(np.uint8)
    events[:, 1, 2] = events[:, 0, 2]
    return Episode(
        observations=observations,
        states=states,
        actions=actions,
        rewards=rng.normal(size=(length, N)).astype(np.float32),
        terminations=ends & (not horizon),
        truncations=ends & horizon,
        events=events,
        layout=rng.normal(size=(n_obstacles, 8)).astype(np.float32),
        seed=seed,
        policy=policy,
        end_reason=end_reason,
    )


def make_recipe(n_steps: int, n_policies: int = 1, seed: int = 0, block: int = 5) -> Recipe:
    """A recipe whose policies have shares 1, 2, 3, ... of the steps."""
    policies = tuple(
        PolicySource(label=f"tag-{p}", name="random", share=p + 1.0) for p in range(n_policies)
    )
    return Recipe(
        id="coop_nav-synthetic-v0",
        tier="synthetic",
        spec=TaskSpec(team=(Role(count=N),)),
        policies=policies,
        seed=seed,
        n_steps=n_steps,
        splits=Splits(block=block),
    )


def make_streams(lengths: Sequence[Sequence[int]]) -> list[list[Episode]]:
    """One stream of episodes per policy, from their lengths."""
    return [
        [make_episode(n, seed=1000 * policy + index, policy=policy) for index, n in enumerate(row)]
        for policy, row in enumerate(lengths)
    ]


def write_streams(
    folder: Path, streams: Sequence[Sequence[Episode]], per_part: int = 3
) -> dict[int, list[Path]]:
    """Writes every stream as parts of `per_part` episodes; returns their folders by policy."""
    parts: dict[int, list[Path]] = {}
    for policy, stream in enumerate(streams):
        for start in range(0, len(stream), per_part):
            path = folder / f"policy-{policy}-part-{start:04d}"
            write_part(path, stream[start : start + per_part])
            parts.setdefault(policy, []).append(path)
    return parts


def make_dataset(
    out: Path, lengths: Sequence[Sequence[int]], n_steps: int | None = None, block: int = 5
) -> tuple[Manifest, list[Episode]]:
    """Writes a dataset at `out`; returns its manifest and the episodes it must hold, in order."""
    streams = make_streams(lengths)
    parts = write_streams(out.parent / f"{out.name}.parts", streams)
    wanted = n_steps if n_steps is not None else sum(lengths[0])
    recipe = make_recipe(wanted, n_policies=len(lengths), block=block)
    merge = merge_order(recipe, lengths)
    assert merge.lacking is None
    manifest = assemble(out, recipe=recipe, parts=parts, order=merge.order)
    return manifest, [streams[policy][episode] for policy, episode in merge.order]
