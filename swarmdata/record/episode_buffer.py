"""EpisodeBuffer: the rows of a running episode, and the `Episode` made of them when it ends."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from swarmdata.store.arrays.layout import TIME_FIELDS
from swarmdata.types import END_REASONS, Bool, Counts, Episode, Float, FloatOrByte


@dataclass(frozen=True, slots=True, eq=False)
class StateRow:
    """The state between two steps; its arrays are not shared."""

    observations: FloatOrByte  # [N, O]
    state: FloatOrByte  # [S]
    alive: Bool  # [N] agents that act next
    masks: Bool | None  # [N, C] allowed choices, None where there are no masks
    sent: Float  # [N, P]
    delivered: Bool  # [N, N], or [N, 0] without a channel
    ages: Counts  # shape of `delivered`


@dataclass(frozen=True, slots=True, eq=False)
class StepRow:
    """One joint action and its consequences; its arrays are not shared."""

    actions: Float  # [N, A]
    log_probs: Float  # [N], or [0] if none are recorded
    rewards: Float  # [N]
    terminations: Bool  # [N] of agents that acted
    truncations: Bool  # [N] of agents that acted and were not terminated
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
        """Steps taken, T."""
        return len(self.steps)

    def add(self, step: StepRow, reached: StateRow) -> None:
        """Appends a step and the state that it reached."""
        self.steps.append(step)
        self.states.append(reached)

    def episode(self, outcome: Outcome = None, *, is_cut: bool = False) -> Episode:
        """Returns the recorded episode.

        The team's episode is truncated if any agent was truncated in the last step, because the
        value of the last state must then be bootstrapped.

        Args:
            outcome: what the environment reported in the last step.
            is_cut: whether the episode was left before its end; agents that were alive then count
                as truncated.
        """
        rows, states, last = self.steps, self.states, len(self) - 1
        agent_terminations = np.stack([row.terminations for row in rows])
        agent_truncations = np.stack([row.truncations for row in rows])
        alive = np.stack([row.alive for row in states])
        if is_cut:
            agent_truncations[last] |= alive[-1]
            alive[-1] = False
        is_truncated = bool(agent_truncations[last].any())
        at_end = np.arange(len(self)) == last
        end_reason = "horizon" if is_truncated else outcome or "ended"
        if outcome == "success":
            end_reason = "success"
        masks = [row.masks for row in states if row.masks is not None]
        terms = [row.reward_terms for row in rows if row.reward_terms is not None]
        return Episode(
            observations=np.stack([row.observations for row in states]),
            states=np.stack([row.state for row in states]),
            actions=np.stack([row.actions for row in rows]),
            log_probs=np.stack([row.log_probs for row in rows]),
            rewards=np.stack([row.rewards for row in rows]),
            terminations=at_end & (not is_truncated),
            truncations=at_end & is_truncated,
            events=np.stack([row.events for row in rows]),
            sent=np.stack([row.sent for row in states]),
            delivered=np.stack([row.delivered for row in states]),
            ages=np.stack([row.ages for row in states]),
            layout=self.layout,
            seed=self.seed,
            policy=self.policy,
            end_reason=END_REASONS.index(end_reason),
            reward_terms=np.stack(terms) if terms else None,
            alive=alive,
            action_masks=np.stack(masks) if masks else None,
            agent_terminations=agent_terminations,
            agent_truncations=agent_truncations,
        )


ARRAY_BYTES = 128
"""What an array takes in memory besides its values: most of an episode of a single step."""


def episode_bytes(episode: Episode) -> int:
    """What the arrays of an episode take in memory."""
    names = (*TIME_FIELDS, *episode.optional)
    return sum(getattr(episode, name).nbytes + ARRAY_BYTES for name in names)
