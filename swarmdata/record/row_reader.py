"""What passes through a `ParallelEnv` as rows of numbers: checked, copied, padded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.record.episode_buffer import Outcome
from swarmdata.record.foreign_environment import MASK
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.spaces import DiscreteSpace, MultiDiscreteSpace, Space, flatten, width
from swarmdata.types import Bool, Float

SUCCESS = ("success", "is_success")
"""Keys of infos that say whether the task was solved."""


@dataclass(frozen=True, slots=True)
class Reader:
    """Reads what an environment and its policies say, by agent, into arrays of all agents.

    Every array is new: environments reuse theirs.

    Attributes:
        names: of all possible agents, as the environment has them, [N].
        agents: the same, described.
    """

    names: tuple[Any, ...]
    agents: tuple[RecordedAgent, ...]

    def alive(self, present: Sequence[Any]) -> Bool:
        """Who is in the environment's `agents`, [N].

        Raises:
            SchemaError: an agent that was not among the possible ones.
        """
        unknown = [name for name in present if name not in self.names]
        if unknown:
            raise SchemaError(
                f"agents {unknown} appeared, which are not in possible_agents {list(self.names)}: "
                "a recording needs to know all agents beforehand."
            )
        return np.array([name in present for name in self.names])

    def observations(self, given: Mapping[Any, Any], seen: Bool) -> tuple[Float, Float]:
        """All observations, zero of agents that are not there.

        Args:
            given: observations by agent.
            seen: who is there, or has left just now, [N].

        Returns:
            rows padded to the widest agent, [N, O], and all of them without padding in one, [sum].
        """
        there = self._of(given, seen, "observation")
        spaces = [agent.observation for agent in self.agents]
        plain = [self._row(space, there, name, "observation of")
                 for space, name in zip(spaces, self.names, strict=True)]  # fmt: skip
        return _padded(plain), np.concatenate(plain)

    def actions(self, given: Mapping[Any, Any], alive: Bool) -> Float:
        """All actions, zero for agents that are not alive, [N, A].

        Raises:
            SchemaError: no action for an agent that acts, or one that its space cannot have.
        """
        acting = self._of(given, alive, "action")
        spaces = [agent.action for agent in self.agents]
        pairs = zip(spaces, self.names, strict=True)
        return _padded([self._row(space, acting, name, "action of") for space, name in pairs])

    def numbers(self, given: Mapping[Any, Any], acted: Bool, what: str) -> Float:
        """One number such as its reward of each agent that acted, zero of the others, [N].

        Raises:
            SchemaError: there is none, or it is no finite number.
        """
        numbers = np.zeros(len(self.names), dtype=np.float32)
        there = self._of(given, acted, what)
        for index, name in enumerate(self.names):
            value = np.asarray(there.get(name, 0.0))
            if value.size != 1 or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
                raise SchemaError(
                    f"{what} of {name} is {given[name]!r}, expected one finite number"
                )
            numbers[index] = value.item()
        return numbers

    def flags(self, given: Mapping[Any, Any], acted: Bool) -> Bool:
        """Flags of the agents that acted, [N]."""
        return np.array([bool(given.get(name, False)) for name in self.names]) & acted

    def has_masks(self, observations: Mapping[Any, Any], infos: Mapping[Any, Any]) -> bool:
        """Whether any agent was told which actions are allowed."""
        return any(_mask_of(name, observations, infos) is not None for name in self.names)

    def masks(self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool) -> Bool:
        """Allowed choices, [N, C]: of an agent without a mask all of its own, of the dead none.

        A multi-discrete action has the choices of its parts one after the other.

        Raises:
            SchemaError: a mask of another length.
        """
        counts = [n_choices(agent.action) for agent in self.agents]
        masks = np.zeros((len(counts), max(counts)), dtype=np.bool_)
        for index, (name, count) in enumerate(zip(self.names, counts, strict=True)):
            given = _mask_of(name, observations, infos)
            if not alive[index]:
                continue
            row = np.ones(count, np.bool_) if given is None else _joined_mask(given)
            if len(row) != count:
                raise SchemaError(
                    f"action mask of {name} has {len(row)} values, expected {count} (the choices "
                    f"of {self.agents[index].action})"
                )
            masks[index, :count] = row
        return masks

    def outcome(self, infos: Mapping[Any, Any]) -> Outcome:
        """What the infos of the last step say: success if all agents that say anything had it."""
        said = [bool(np.all(info[key])) for info in infos.values() for key in SUCCESS
                if isinstance(info, Mapping) and key in info]  # fmt: skip
        return None if not said else "success" if all(said) else "failure"

    def _of(self, given: Mapping[Any, Any], wanted: Bool, what: str) -> dict[Any, Any]:
        """What is given of the agents that are wanted, all of them."""
        names = [name for name, is_wanted in zip(self.names, wanted, strict=True) if is_wanted]
        if missing := [name for name in names if name not in given]:
            raise SchemaError(f"no {what} of {missing}, expected one of each of {names}")
        return {name: given[name] for name in names}

    def _row(self, space: Space, given: Mapping[Any, Any], name: Any, what: str) -> Float:
        if name not in given:
            return np.zeros(width(space), dtype=np.float32)
        return flatten(space, given[name], f"{what} {name}")


def n_choices(space: Space) -> int:
    """Entries of an action mask; 0 for actions that are not choices."""
    match space:
        case DiscreteSpace():
            return space.n
        case MultiDiscreteSpace():
            return sum(space.n)
    return 0


def _mask_of(name: Any, observations: Mapping[Any, Any], infos: Mapping[Any, Any]) -> Any:
    """The mask in an agent's info or observation, PettingZoo's two conventions, or None."""
    for source in (infos.get(name), observations.get(name)):
        if isinstance(source, Mapping) and source.get(MASK) is not None:
            return source[MASK]
    return None


def _joined_mask(given: Any) -> Bool:
    """A mask as one row; those of a multi-discrete action may come as a tuple."""
    parts = given if isinstance(given, tuple | list) else (given,)
    return np.concatenate([np.ravel(np.asarray(part)).astype(np.bool_) for part in parts])


def _padded(rows: Sequence[Float]) -> Float:
    result = np.zeros((len(rows), max(map(len, rows))), dtype=np.float32)
    for index, row in enumerate(rows):
        result[index, : len(row)] = row
    return result
