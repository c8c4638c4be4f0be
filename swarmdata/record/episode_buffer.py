"""EpisodeBuffer: the rows of a running episode, and the `Episode` made of them when it ends."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from swarmdata.store.arrays.layout import TIME_FIELDS
from swarmdata.types import END_REASONS, Bool, Counts, Episode, Float, FloatOrByte


@dataclass(frozen=True, slots=True, eq=False)
class StateRow:
    """The state between two steps, by the names of an episode's fields; its arrays are its own."""

    observations: FloatOrByte  # [N, O]
    states: FloatOrByte  # [S]
    alive: Bool  # [N] agents that act next
    action_masks: Bool | None  # [N, C] allowed choices, None where there are no masks
    sent: Float  # [N, P]
    delivered: Bool  # [N, N], or [N, 0] without a channel
    ages: Counts  # shape of `delivered`


@dataclass(frozen=True, slots=True, eq=False)
class StepRow:
    """One joint action and its consequences, likewise."""

    actions: Float  # [N, A]
    log_probs: Float  # [N], or [0] if none are recorded
    rewards: Float  # [N]
    agent_terminations: Bool  # [N] of agents that acted
    agent_truncations: Bool  # [N] of agents that acted and were not terminated
    events: Counts  # [N, 4], or [N, 0] without events
    reward_terms: Float | None = None  # [N, R] of a task of this library


Outcome = Literal["success", "failure"] | None
"""What the environment reported about the task; None: nothing."""


@dataclass(slots=True, eq=False)
class EpisodeBuffer:
    """A running episode."""

    seed: int  # seed of the reset
    policy: int  # index of the acting policy
    layout: Float  # obstacles, [M, 8]
    states: list[StateRow]  # T + 1 rows, the reset first
    steps: list[StepRow] = field(default_factory=list)  # T rows

    def __len__(self) -> int:
        return len(self.steps)

    def episode(self, outcome: Outcome = None, *, is_cut: bool = False) -> Episode:
        """Returns the recorded episode, given the outcome that the environment reported.

        It is truncated if any agent was in the last step, because the value of the last state must
        then be bootstrapped. With `is_cut` it was left early, and truncates the living agents.
        """
        arrays = {**_stacked(self.states), **_stacked(self.steps)}
        if is_cut:
            arrays["agent_truncations"][-1] |= arrays["alive"][-1]
            arrays["alive"][-1] = False
        is_truncated = bool(arrays["agent_truncations"][-1].any())
        at_end = np.arange(len(self)) == len(self) - 1
        unsolved = "horizon" if is_truncated else outcome or "ended"
        end_reason = "success" if outcome == "success" else unsolved
        return Episode(
            **arrays,
            terminations=at_end & (not is_truncated),
            truncations=at_end & is_truncated,
            layout=self.layout,
            seed=self.seed,
            policy=self.policy,
            end_reason=END_REASONS.index(end_reason),
        )


def _stacked(rows: Sequence[StateRow] | Sequence[StepRow]) -> dict[str, Any]:
    """The arrays of some rows, [len(rows), ...] each; None where the rows have none."""
    columns = {name: [getattr(row, name) for row in rows] for name in rows[0].__slots__}
    return {name: None if each[0] is None else np.stack(each) for name, each in columns.items()}


ARRAY_BYTES = 128
"""What an array takes in memory besides its values: most of an episode of a single step."""


def episode_bytes(episode: Episode) -> int:
    """What the arrays of an episode take in memory."""
    names = (*TIME_FIELDS, *episode.optional)
    return sum(getattr(episode, name).nbytes + ARRAY_BYTES for name in names)
