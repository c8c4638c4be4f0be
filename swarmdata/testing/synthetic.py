"""Synthetic episodes and datasets, whose values name their episode, time and agent."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from swarmdata.specs.recipe import PolicySource, Recipe, Splits
from swarmdata.specs.sensing_models import Broadcast, StateModel
from swarmdata.specs.task_spec import Obstacles, Role, TaskSpec
from swarmdata.store import Manifest
from swarmdata.store.assembly import assemble
from swarmdata.store.episode_order import merge_order
from swarmdata.store.parts import write_part
from swarmdata.types import END_REASONS, EVENTS, TASK_END_REASONS, Counts, Episode

SPEC = TaskSpec(
    team=(Role(count=2),),
    observation=StateModel(n_neighbors=0, n_obstacles=0),
    obstacles=Obstacles(boxes=2, corners=0, pockets=0),
    communication=Broadcast(),
)
"""A small task, whose shapes the episodes have."""

N_AGENTS, STATE_SIZE, ACTION_SIZE, N_OBSTACLES = 2, 16, 2, 4
N_FEATURES, N_VALUES = 15, 4

RELEASE_CARD = "---\ntags:\n- swarmdata\n---\n# Synthetic\n"
"""The card of a dataset that may be published."""


def make_episode(
    length: int,
    seed: int,
    policy: int = 0,
    n_obstacles: int = N_OBSTACLES,
    n_agents: int = N_AGENTS,
    n_features: int = N_FEATURES,
    n_states: int = STATE_SIZE,
    n_values: int = N_VALUES,
) -> Episode:
    """Feature 0 is the seed, feature 1 the time, feature 2 the agent; the rest is noise.

    Robots send messages of `n_values` values; with 0 there is no channel.
    """
    rng = np.random.default_rng([seed, policy])
    observations = rng.standard_normal((length + 1, n_agents, n_features), dtype=np.float32)
    observations[..., 0] = seed
    observations[..., 1] = np.arange(length + 1)[:, None]
    observations[..., 2] = np.arange(n_agents)
    states = rng.standard_normal((length + 1, n_states), dtype=np.float32)
    states[:, 0] = seed
    states[:, 1] = np.arange(length + 1)
    end_reason = int(rng.integers(len(TASK_END_REASONS)))
    ends = np.arange(length) == length - 1
    horizon = END_REASONS[end_reason] == "horizon"
    links = (length + 1, n_agents, n_agents if n_values else 0)
    return Episode(
        observations=observations,
        states=states,
        actions=rng.uniform(-1, 1, size=(length, n_agents, ACTION_SIZE)).astype(np.float32),
        log_probs=rng.standard_normal((length, n_agents), dtype=np.float32),
        rewards=rng.standard_normal((length, n_agents), dtype=np.float32),
        terminations=ends & (not horizon),
        truncations=ends & horizon,
        events=_make_events(rng, length, n_agents),
        sent=rng.standard_normal((length + 1, n_agents, n_values), dtype=np.float32),
        delivered=rng.random(links) < 0.5,
        ages=rng.integers(0, 256, links, dtype=np.uint8),
        layout=rng.standard_normal((n_obstacles, 8), dtype=np.float32),
        seed=seed,
        policy=policy,
        end_reason=end_reason,
    )


def _make_events(rng: np.random.Generator, length: int, n_agents: int) -> Counts:
    """Random events; contacts between robots begin for agents 0 and 1 together."""
    events = rng.integers(0, 2, size=(length, n_agents, len(EVENTS))).astype(np.uint8)
    onsets = EVENTS.index("robot_onsets")
    events[:, 1, onsets] = events[:, 0, onsets]
    events[:, 2:, onsets] = 0
    return events


def make_recipe(
    n_steps: int, n_policies: int = 1, seed: int = 0, block: int = 5, spec: TaskSpec = SPEC
) -> Recipe:
    """A recipe whose policies have shares 1, 2, 3, ... of the steps."""
    policies = tuple(
        PolicySource(label=f"tag-{p}", name="random", share=p + 1.0) for p in range(n_policies)
    )
    return Recipe(
        id="coop_nav-synthetic-v0", tier="synthetic", spec=spec, policies=policies, seed=seed,
        n_steps=n_steps, splits=Splits(block=block),
    )  # fmt: skip


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
    out: Path,
    lengths: Sequence[Sequence[int]],
    n_steps: int | None = None,
    block: int = 5,
    **changes: str,
) -> tuple[Manifest, list[Episode]]:
    """Writes a dataset at `out`; returns its manifest and the episodes it must hold, in order."""
    streams = make_streams(lengths)
    parts = write_streams(out.parent / f"{out.name}.parts", streams)
    wanted = n_steps if n_steps is not None else sum(lengths[0])
    recipe = make_recipe(wanted, n_policies=len(lengths), block=block)
    recipe = recipe.model_copy(update=changes)
    merge = merge_order(recipe, lengths)
    assert merge.lacking is None
    manifest = assemble(out, recipe=recipe, parts=parts, order=merge.order)
    return manifest, [streams[policy][episode] for policy, episode in merge.order]


def write_release(folder: Path, lengths: Sequence[int], dataset_id: str) -> Path:
    """Writes a finished dataset that may be published: with a card and references."""
    make_dataset(folder, [lengths], n_steps=100, id=dataset_id)
    (folder / "card.md").write_text(RELEASE_CARD)
    (folder / "references.json").write_text("{}")
    return folder
