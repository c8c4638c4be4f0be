"""One joint policy of a policy for each side, and what belongs to the robots of a side."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError, SpecError
from swarmdata.interfaces import Policy, check_acts
from swarmdata.registry.components import make_policy
from swarmdata.specs.rules import Side
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import END_REASONS, Episode, Float, Int, Step

AGENT_ARRAYS = (
    "observations", "actions", "log_probs", "rewards", "reward_terms", "events", "sent",
)  # fmt: skip
"""Arrays whose second axis are the agents: of steps, of episodes, and of datasets."""

PAIR_ARRAYS = ("delivered", "ages")
"""Those whose last axis are agents as well, if they have a channel."""


def rows_of_side(name: str, array: NDArray[Any], side: Side) -> NDArray[Any]:
    """The part of a named array, [E, ...] or [T, ...], that belongs to a side, a view."""
    agents = slice(side.agents.start, side.agents.stop)
    if name in AGENT_ARRAYS:
        return array[:, agents]
    if name in PAIR_ARRAYS:
        return array[:, agents, agents]
    return array


def step_of_side(step: Step, side: Side) -> Step:
    """The same step with the rows of a side's robots."""
    fields = step._asdict()
    return Step(**{name: rows_of_side(name, array, side) for name, array in fields.items()})


class _Seat(NamedTuple):
    side: Side
    policy: Policy
    is_own: bool  # whether the policy sees and moves this side alone


class SidePolicy:
    """Moves each side of a task by a policy of its own, by the side's name.

    Policies of `own` sides see the rows of their side alone, such as those trained on
    `dataset.side(...)`; the others are of the whole task, and only the actions of their side count.
    """

    def __init__(
        self, spec: TaskSpec, policies: Mapping[str, Policy], own: Collection[str] = ()
    ) -> None:
        for name in policies:
            spec.side(name)
        missing = [side.name for side in spec.sides if side.name not in policies]
        if missing:
            raise SpecError(
                f"{spec.task} needs a policy for each side, got {', '.join(policies) or 'none'}. "
                f"Name one for {', '.join(missing)} too"
            )
        self._seats = [_Seat(side, policies[side.name], side.name in own) for side in spec.sides]
        self._shape = (spec.n_agents, spec.action_size)
        self._last: tuple[Step, list[Step]] | None = None

    @property
    def uses_state(self) -> bool:
        """Whether one of the policies does."""
        return any(seat.policy.uses_state for seat in self._seats)

    def reset(self, step: Step, copies: Int) -> None:
        """Clears the memory of every policy in `copies`."""
        for seat in self._seats:
            seat.policy.reset(step_of_side(step, seat.side) if seat.is_own else step, copies)

    def act(self, step: Step) -> Float:
        """Returns the actions of all sides, [E, N, A]."""
        actions: Float = np.empty((len(step.seeds), *self._shape), dtype=np.float32)
        for seat, seen in zip(self._seats, self._seen(step), strict=True):
            found, expected = seat.policy.act(seen), seen.observations.shape[1]
            if found.shape[1:] != (expected, self._shape[1]):
                raise SchemaError(
                    f"the policy of the {seat.side.name} returned actions of shape {found.shape}, "
                    f"expected {(len(actions), expected, self._shape[1])}. Those of the whole task "
                    "are named, and not built: opponents='scripted'"
                )
            agents = slice(seat.side.agents.start, seat.side.agents.stop)
            actions[:, agents] = found if seat.is_own else found[:, agents]
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns those of each side under its policy, [E, N]."""
        found: Float = np.empty(actions.shape[:2], dtype=np.float32)
        for seat, seen in zip(self._seats, self._seen(step), strict=True):
            own = rows_of_side("actions", actions, seat.side)
            logs = seat.policy.log_probs(seen, own if seat.is_own else actions)
            agents = slice(seat.side.agents.start, seat.side.agents.stop)
            found[:, agents] = logs if seat.is_own else logs[:, agents]
        return found

    def _seen(self, step: Step) -> list[Step]:
        """What each policy sees; the same objects for a step as before, as `log_probs` asks for."""
        if self._last is None or self._last[0] is not step:
            seen = [step_of_side(step, seat.side) if seat.is_own else step for seat in self._seats]
            self._last = (step, seen)
        return self._last[1]


def play_sides(
    spec: TaskSpec, side: str, policy: Policy | str, opponents: Policy | str
) -> SidePolicy:
    """Returns a policy for a side, with opponents on the others.

    Both are policies that see the rows of their side alone, or names of registered policies, which
    are of the whole task.
    """
    spec.side(side)
    policies, own = {}, []
    for name in (each.name for each in spec.sides):
        chosen = policy if name == side else opponents
        if isinstance(chosen, str):
            chosen = make_policy(chosen, spec)
        else:
            check_acts(chosen, "reset", "act", "log_probs")
            own.append(name)
        policies[name] = chosen
    return SidePolicy(spec, policies, own)


def end_reason_for(side: Side, end_reason: int) -> int:
    """How an episode ended for a side: one that is not the first wins what the task calls lost."""
    if side.agents.start == 0:
        return end_reason
    won = END_REASONS[end_reason] == "success"
    return END_REASONS.index("failure" if won else "success")


def episode_of_side(episode: Episode, side: Side) -> Episode:
    """The same episode with the rows of a side's robots, and its success."""
    names = [*Step._fields, "actions", "log_probs"]
    arrays: dict[str, Any] = {
        name: rows_of_side(name, array, side)
        for name in names
        if (array := getattr(episode, name, None)) is not None
    }
    return replace(episode, **arrays, end_reason=end_reason_for(side, episode.end_reason))
