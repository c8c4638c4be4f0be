"""Tape, the rows of one running episode, and the `Episode` that they become when it ends."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from swarmdata.types import END_REASONS, Bool, Counts, Episode, Float


@dataclass(frozen=True, slots=True, eq=False)
class StateRow:
    """What holds between two steps; nobody else may write to the arrays."""

    observations: Float  # [N, O]
    state: Float  # [S]
    alive: Bool  # [N] who acts next
    masks: Bool | None  # [N, C] allowed choices, None where there are no masks
    sent: Float  # [N, P]
    delivered: Bool  # [N, N], or [N, 0] without a channel
    ages: Counts  # the same


@dataclass(frozen=True, slots=True, eq=False)
class StepRow:
    """What one joint action was and did; nobody else may write to the arrays."""

    actions: Float  # [N, A]
    log_probs: Float  # [N], or [0] where none are recorded
    rewards: Float  # [N]
    terminations: Bool  # [N] of agents that acted
    truncations: Bool  # [N] of agents that acted and were not terminated
    events: Counts  # [N, 4], or [N, 0] where there are none


Outcome = Literal["success", "failure"] | None
"""What the environment said of the task, None if nothing."""


@dataclass(slots=True, eq=False)
class Tape:
    """One running episode.

    Attributes:
        seed: that it was reset with.
        policy: index of the policy that acts.
        layout: obstacles, [M, 8].
        states: T + 1 rows, the reset first.
        steps: T rows.
    """

    seed: int
    policy: int
    layout: Float
    states: list[StateRow]
    steps: list[StepRow] = field(default_factory=list)

    def __len__(self) -> int:
        """Steps taken, T."""
        return len(self.steps)

    def add(self, step: StepRow, reached: StateRow) -> None:
        """Takes one step and the state it reached."""
        self.steps.append(step)
        self.states.append(reached)

    def episode(self, outcome: Outcome = None, *, is_cut: bool = False) -> Episode:
        """Returns what was recorded.

        The team's end is a truncation if any agent was truncated in the last step: values of what
        would have come must then be bootstrapped.

        Args:
            outcome: what the environment said in the last step.
            is_cut: whether the episode had not ended; who was alive then counts as truncated.
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
        masks = [row.masks for row in states if row.masks is not None]
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
            end_reason=END_REASONS.index(_reason(outcome, is_truncated)),
            alive=alive,
            action_masks=np.stack(masks) if masks else None,
            agent_terminations=agent_terminations,
            agent_truncations=agent_truncations,
        )


def _reason(outcome: Outcome, is_truncated: bool) -> str:
    if outcome == "success":
        return outcome
    return "horizon" if is_truncated else outcome or "ended"


def n_bytes(episode: Episode) -> int:
    """Memory of an episode's largest arrays."""
    return episode.observations.nbytes + episode.states.nbytes + episode.actions.nbytes
