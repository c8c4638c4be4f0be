"""Turns the dictionaries of a `ParallelEnv` into arrays of all agents: checked, copied, padded."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.record.episode_buffer import Outcome
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.spaces import (
    Limits,
    Space,
    as_bytes,
    flatten,
    holds_bytes,
    limits_of,
    n_choices,
    stack_agents,
    to_float32,
    width,
)
from swarmdata.types import Bool, Float, FloatOrByte

ACTION_MASK_KEY = "action_mask"
"""Key of the action mask in an agent's info or observation (PettingZoo, "Action Masking")."""

SUCCESS_KEYS = ("success", "is_success")  # keys of infos that tell whether the task was solved


@dataclass(frozen=True)
class AgentReader:
    """Reads values by agent, of an environment or its policies, into arrays of all agents.

    Arrays are copies, because environments reuse theirs. What is missing, does not fit its space or
    is not finite in float32 raises SchemaError.
    """

    names: tuple[Any, ...]  # possible agents as the environment names them, [N]
    agents: tuple[RecordedAgent, ...]  # their descriptions, [N]

    def alive(self, present: Sequence[Any]) -> Bool:
        """Which agents are in the environment's `agents`, [N]; SchemaError if one is unknown."""
        unknown = [name for name in present if name not in self.names]
        if unknown:
            raise SchemaError(
                f"agents {unknown} appeared, which are not in possible_agents {list(self.names)}: "
                "a recording needs the names of all agents beforehand."
            )
        return np.array([name in present for name in self.names])

    def observations(self, given: Mapping[Any, Any], seen: Bool) -> tuple[FloatOrByte, FloatOrByte]:
        """Observations of the agents that are seen, [N], zeros for others.

        Returns:
            rows padded to the widest agent, [N, O], and their concatenation without padding; uint8
            if all agents observe images of bytes.
        """
        spaces = [agent.observation for agent in self.agents]
        rows = self._rows(given, seen, "observation", spaces)
        if all(map(holds_bytes, spaces)):
            names = (f"observation of {name}" for name in self.names)
            images = [as_bytes(row, where) for row, where in zip(rows, names, strict=True)]
            return stack_agents(images), np.concatenate(images)
        return stack_agents(rows), np.concatenate(rows)

    def actions(self, given: Mapping[Any, Any], alive: Bool) -> Float:
        """Actions of all agents; zeros for agents that are not alive, [N, A]."""
        spaces = [agent.action for agent in self.agents]
        rows = stack_agents(self._rows(given, alive, "action", spaces))
        self._limits.check(rows, alive, self.names)
        return rows

    @cached_property
    def _limits(self) -> Limits:
        """What actions may be."""
        return limits_of([agent.action for agent in self.agents])

    def numbers(self, given: Mapping[Any, Any], acted: Bool, what: str) -> Float:
        """One number, such as the reward, of each agent that acted; zero for the others, [N]."""
        numbers = np.zeros(len(self.names), dtype=np.float32)
        known = self._require(given, acted, what)
        for index, name in enumerate(self.names):
            value = np.asarray(known.get(name, 0.0))
            if value.size != 1:
                raise SchemaError(f"{what} of {name} is {given[name]!r}, expected one number")
            numbers[index] = to_float32(value, f"{what} of {name}").item()
        return numbers

    def flags(self, given: Mapping[Any, Any], acted: Bool) -> Bool:
        """Flags of all agents; false for agents that did not act, [N]."""
        return np.array([bool(given.get(name, False)) for name in self.names]) & acted

    def has_masks(self, observations: Mapping[Any, Any], infos: Mapping[Any, Any]) -> bool:
        return any(_mask_of(name, observations, infos) is not None for name in self.names)

    def masks(self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool) -> Bool:
        """Allowed choices of each action's parts, [N, C]: all without a mask, none of the dead."""
        counts = [n_choices(agent.action) for agent in self.agents]
        masks = np.zeros((len(counts), max(counts)), dtype=np.bool_)
        for index, (name, count) in enumerate(zip(self.names, counts, strict=True)):
            given = _mask_of(name, observations, infos)
            if not alive[index]:
                continue
            row = np.ones(count, np.bool_)
            if given is not None:
                # masks of a multi-discrete action may come as a tuple
                parts = given if isinstance(given, tuple | list) else (given,)
                row = np.concatenate([np.ravel(part).astype(np.bool_) for part in parts])
            if len(row) != count:
                raise SchemaError(
                    f"action mask of {name} has {len(row)} values, expected {count} (the choices "
                    f"of {self.agents[index].action})"
                )
            masks[index, :count] = row
        return masks

    def _require(self, given: Mapping[Any, Any], wanted: Bool, what: str) -> dict[Any, Any]:
        """The given values of the wanted agents; none may be missing."""
        names = list(compress(self.names, wanted))
        if missing := [name for name in names if name not in given]:
            raise SchemaError(f"no {what} of {missing}, expected one of each of {names}")
        return {name: given[name] for name in names}

    def _rows(
        self, given: Mapping[Any, Any], wanted: Bool, what: str, spaces: Sequence[Space]
    ) -> list[Float]:
        """The values of the wanted agents as rows, zeros for the others."""
        known = self._require(given, wanted, what)
        return [
            flatten(space, known[name], f"{what} of {name}")
            if name in known
            else np.zeros(width(space), dtype=np.float32)
            for space, name in zip(spaces, self.names, strict=True)
        ]


@dataclass(slots=True)
class Presence:
    """Which agents act, from a reset on: one that has ended does not, even where it is listed."""

    reader: AgentReader  # reads the environment's `agents`
    alive: Bool  # agents that act next, [N]
    gone: Bool  # agents that have ended and that the environment still lists, [N]
    successes: dict[Any, bool] = field(default_factory=dict)  # that agents reported as they ended

    @classmethod
    def after_reset(cls, reader: AgentReader, present: Sequence[Any]) -> "Presence":
        """All agents that an environment lists after a reset."""
        alive = reader.alive(present)
        return cls(reader, alive, np.zeros_like(alive))

    def step(self, ended: Bool, present: Sequence[Any], infos: Mapping[Any, Any]) -> Bool:
        """Which agents act next, [N].

        Those `ended`, [N], have a flag; `present` and `infos` are the environment's after the step.

        Raises:
            SchemaError: an agent is gone without a flag, so that nobody knows why it ended.
        """
        listed = self.reader.alive(present)
        lost = self.alive & ~ended & ~listed
        if lost.any():
            raise SchemaError(
                f"agents {list(compress(self.reader.names, lost))} are no longer in `agents`, but "
                "were neither terminated nor truncated, so nobody knows whether to bootstrap. Let "
                "the environment set one of the flags in the step in which an agent leaves."
            )
        self.gone = (self.gone | ended) & listed
        self.alive = listed & ~self.gone
        found = _successes(infos)
        self.successes |= {n: found[n] for n in compress(self.reader.names, ended) if n in found}
        if not self.alive.any():  # infos may be of others than agents, too
            self.successes = found | self.successes
        return self.alive

    @property
    def outcome(self) -> Outcome:
        """What agents reported as they ended, and the infos of the last step of anybody else."""
        return combine_outcomes(self.successes.values())


def _successes(infos: Mapping[Any, Any]) -> dict[Any, bool]:
    """Whether those succeeded whose infos say so or not, by the keys of `infos`."""
    return {
        name: all(bool(np.all(info[key])) for key in SUCCESS_KEYS if key in info)
        for name, info in infos.items()
        if isinstance(info, Mapping) and not info.keys().isdisjoint(SUCCESS_KEYS)
    }


def combine_outcomes(successes: Iterable[bool]) -> Outcome:
    """Success if every agent that reported an outcome succeeded; None if none reported one."""
    reported = list(successes)
    if not reported:
        return None
    return "success" if all(reported) else "failure"


def _mask_of(name: Any, observations: Mapping[Any, Any], infos: Mapping[Any, Any]) -> Any:
    """The mask in an agent's info or observation (PettingZoo has both conventions), or None."""
    for source in (infos.get(name), observations.get(name)):
        if isinstance(source, Mapping) and source.get(ACTION_MASK_KEY) is not None:
            return source[ACTION_MASK_KEY]
    return None
