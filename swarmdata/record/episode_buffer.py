"""EpisodeBuffer: the rows of a running episode, and the `Episode` made of them when it ends."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from swarmdata.store.arrays.layout import TIME_FIELDS
from swarmdata.types import END_REASONS, Episode, Float

Row = dict[str, Any]
"""Arrays of a state or a step, by the names of an episode's fields; None for those it lacks."""

Outcome = Literal["success", "failure"] | None
"""What the environment reported about the task; None: nothing."""


@dataclass(slots=True, eq=False)
class EpisodeBuffer:
    """A running episode."""

    seed: int  # seed of the reset
    policy: int  # index of the acting policy
    layout: Float  # obstacles, [M, 8]
    states: list[Row]  # T + 1 rows, the reset first
    steps: list[Row] = field(default_factory=list)  # T rows

    def __len__(self) -> int:
        return len(self.steps)

    def episode(self, outcome: Outcome = None, *, is_cut: bool = False) -> Episode:
        """Returns the recorded episode, given the outcome that the environment reported.

        It is truncated if any agent was in the last step, because the value of the last state must
        then be bootstrapped. With `is_cut` it was left early, and truncates the living agents.
        """
        arrays: dict[str, Any] = {
            name: None if first is None else np.stack([row[name] for row in rows])
            for rows in (self.states, self.steps)
            for name, first in rows[0].items()
        }
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


ARRAY_BYTES = 128  # of an array in memory besides its values: most of an episode of a single step


def episode_bytes(episode: Episode) -> int:
    """What the arrays of an episode take in memory."""
    names = (*TIME_FIELDS, *episode.optional)
    return sum(getattr(episode, name).nbytes + ARRAY_BYTES for name in names)
