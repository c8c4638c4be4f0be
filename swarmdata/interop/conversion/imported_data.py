"""ImportedData: the spec and the episodes that a format's reader hands over."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import Arrays
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.origins import AnySpec, RecordedSpec
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import BoxSpace, DiscreteSpace, MultiDiscreteSpace, Space
from swarmdata.types import END_REASONS, Bool, Counts, Episode, Float, no_messages

UNKNOWN_POLICIES = (PolicySource(label="unknown", name="external"),)
"""Behavior policies of data that do not name them."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportedData:
    """What a format's reader hands over."""

    spec: AnySpec  # spec of the environment
    policies: tuple[PolicySource, ...]  # the behavior policies
    episodes: Iterator[Episode]  # in order; read lazily, so valid only while the source is open
    splits: Counts | None = None  # split of each episode, if known
    metadata: Mapping[str, str] = field(default_factory=dict)
    """The user's answers and what the reader left out."""


@dataclass(frozen=True, slots=True)
class AgentShapes:
    """Sizes of foreign agents, known before any episode is read."""

    observations: tuple[int, ...]  # number of columns of each agent's observation
    actions: tuple[int, ...]  # number of columns of each agent's action
    choices: tuple[tuple[int, ...], ...]
    """Number of values in each column of each agent's discrete action, () if it is continuous."""
    states: int  # number of columns of the state, 0 without states


def spec_from_shapes(task: str, shapes: AgentShapes, choices: Choices) -> RecordedSpec:
    """The spec of an environment of which only data exist."""
    n = len(shapes.observations)
    names = choices.agents or tuple(f"agent_{k}" for k in range(n))
    if choices.team_size not in (None, n):
        raise ConversionError(
            f"agents is {choices.agents or choices.team_size}, expected {n} as in the data"
        )
    agents = [
        {
            "name": name,
            "observation": BoxSpace(shape=(columns,), dtype="float32"),
            "action": _action_space(width, counts, choices),
        }
        for name, columns, width, counts in zip(
            names, shapes.observations, shapes.actions, shapes.choices, strict=True
        )
    ]
    content = {
        "task": task,
        "agents": agents,
        "state_size": shapes.states or sum(shapes.observations),
        "state_from": "environment" if shapes.states else "observations",
        "horizon": choices.time_limit or None,
    }
    return RecordedSpec.parse(content, "the data to convert")


def _action_space(width: int, counts: tuple[int, ...], choices: Choices) -> Space:
    if len(counts) == 1:
        return DiscreteSpace(n=counts[0])
    if counts:
        return MultiDiscreteSpace(n=counts)
    return BoxSpace(
        shape=(width,), dtype="float32", low=choices.action_low, high=choices.action_high
    )


def build_episode(
    rows: Arrays, *, seed: int, policy: int, end: str | int, layout: Float | None = None
) -> Episode:
    """Builds an episode of the given arrays; all others are empty.

    There are at least observations [T+1, N, O], actions [T, N, A] and rewards [T, N]. The end is
    `termination`, `truncation`, or the code of an end reason; it gives the team's flags where
    `rows` has none. The layout is [M, 8].
    """
    n, n_agents = rows["rewards"].shape
    if isinstance(end, str):
        end = END_REASONS.index("ended" if end == "termination" else "horizon")
    last = np.arange(n) == n - 1
    is_cut = END_REASONS[end] == "horizon"
    empty: dict[str, Any] = {
        "states": np.zeros((n + 1, 0), dtype=np.float32),
        "log_probs": np.zeros((n, 0), dtype=np.float32),
        "events": np.zeros((n, n_agents, 0), dtype=np.uint8),
        "terminations": last & (not is_cut),
        "truncations": last & is_cut,
        "layout": np.zeros((0, 8), dtype=np.float32) if layout is None else layout,
        **no_messages(n + 1, n_agents),
    }
    return Episode(**{**empty, **rows, "seed": seed, "policy": policy, "end_reason": end})


def leaving(acting: Bool, terminated: Bool) -> dict[str, Bool]:
    """Arrays of an episode in which agents do not always act, and where they terminate, [T, N]."""
    alive = np.concatenate([acting, np.zeros_like(acting[:1])])
    stops = acting & ~alive[1:]
    cut = stops & ~terminated
    return {"alive": alive, "agent_terminations": stops & terminated, "agent_truncations": cut}
