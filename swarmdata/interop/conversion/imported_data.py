"""Incoming, foreign data on its way into a dataset: its spec, and its episodes one by one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.origins import AnySpec, RecordedSpec
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import BoxSpace, DiscreteSpace, Space
from swarmdata.types import END_REASONS, Counts, Episode, Float, no_messages

UNKNOWN = (PolicySource(label="unknown", name="external"),)
"""Behavior policies of data that does not say who acted."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Incoming:
    """What a format's reader hands over.

    Attributes:
        spec: of the environment.
        policies: who acted.
        episodes: in order; read while they are taken, so valid while the source is open.
        splits: of each episode, if they are known.
        metadata: what the reader was told and what it left out.
    """

    spec: AnySpec
    policies: tuple[PolicySource, ...]
    episodes: Iterator[Episode]
    splits: Counts | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Shapes:
    """What is known of foreign agents before any episode is read.

    Attributes:
        observations: columns of each agent's observation.
        actions: columns of each agent's action.
        choices: how many values a discrete action has, 0 for continuous ones.
        states: columns of the state, 0 where there is none.
    """

    observations: tuple[int, ...]
    actions: tuple[int, ...]
    choices: int
    states: int


def measured_spec(task: str, shapes: Shapes, choices: Choices) -> RecordedSpec:
    """The spec of an environment of which there is only data.

    Raises:
        ConversionError: not as many names as agents.
        SpecError: a name or a size that a recording cannot have.
    """
    n = len(shapes.observations)
    names = choices.agents or tuple(f"agent_{k}" for k in range(n))
    if len(names) != n:
        raise ConversionError(f"{len(names)} agent names {names} for {n} agents in the data")
    agents = []
    for name, columns, width in zip(names, shapes.observations, shapes.actions, strict=True):
        bounded = BoxSpace(
            shape=(width,), dtype="float32", low=choices.action_low, high=choices.action_high
        )
        action: Space = DiscreteSpace(n=shapes.choices) if shapes.choices else bounded
        observation = BoxSpace(shape=(columns,), dtype="float32")
        agents.append({"name": name, "observation": observation, "action": action})
    content = {
        "task": task,
        "agents": agents,
        "state_size": shapes.states or sum(shapes.observations),
        "state_from": "environment" if shapes.states else "observations",
        "horizon": choices.time_limit or None,
    }
    return RecordedSpec.parse(content, "the data to convert")


def stacked(arrays: Sequence[NDArray[Any]]) -> Float:
    """Rows of several agents as one array, [n, N, widest], float32, zeros on the right."""
    widest = max(array.shape[1] for array in arrays)
    rows = np.zeros((len(arrays[0]), len(arrays), widest), dtype=np.float32)
    for agent, array in enumerate(arrays):
        rows[:, agent, : array.shape[1]] = array
    return rows


def episode_of(
    rows: Arrays, *, seed: int, policy: int, end: str | int, layout: Float | None = None
) -> Episode:
    """Builds an episode of what there is; everything else is empty.

    Args:
        rows: at least observations [T+1, N, O], actions [T, N, A] and rewards [T, N].
        seed: of the episode.
        policy: index into the policies.
        end: `termination` or `truncation`, or the code of the end reason, whose flags are in
            `rows` or follow from it.
        layout: obstacles, [M, 8].
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
