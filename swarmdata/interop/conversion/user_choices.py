"""Choices: what only the user knows about foreign data."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal

from swarmdata.errors import ConversionError, UnknownNameError


@dataclass(frozen=True)
class Choices:
    """Answers to questions that a format leaves open; None: not answered."""

    time_limit: int | None = None
    """Steps after which the environment truncates an episode. An end at exactly this step is then a
    truncation, whatever its flag says. 0: no limit, the flags are right."""
    episode_length: int | None = None
    """Number of steps of every episode, for data without usable flags."""
    final: Literal["repeat", "cut"] | None = None
    """What to do if the observation after an episode's last action was not stored: `repeat` copies
    the one before it; `cut` does so only for terminated episodes, where no learner reads it, and
    drops the last step of truncated ones."""
    unfinished: Literal["truncate", "drop"] | None = None
    """What to do with rows after the last end: `truncate` makes a truncated episode of them, `drop`
    leaves them out."""
    n_agents: int | None = None  # number of agents whose columns are concatenated
    action_low: float | None = None  # least value of every action; None: unbounded
    action_high: float | None = None  # greatest value of every action; None: unbounded
    agents: tuple[str, ...] | None = None  # names, in order; by default `agent_0`, `agent_1`, ...

    def __post_init__(self) -> None:
        problems = []
        for name, least in (("time_limit", 0), ("episode_length", 1), ("n_agents", 1)):
            value: Any = getattr(self, name)
            if value is None:
                continue
            if type(value) is bool or not isinstance(value, Integral) or int(value) < least:
                problems.append(f"{name} is {value!r}, expected a whole number of at least {least}")
        if self.final not in (None, "repeat", "cut"):
            problems.append(f"final is {self.final!r}, expected 'repeat' or 'cut'")
        if self.unfinished not in (None, "truncate", "drop"):
            problems.append(f"unfinished is {self.unfinished!r}, expected 'truncate' or 'drop'")
        if self.agents is not None and len(set(self.agents)) != len(self.agents):
            problems.append(f"agents are {self.agents}, expected different names")
        low, high = self.action_low, self.action_high
        bounds: list[Any] = [each for each in (low, high) if each is not None]
        if not all(isinstance(each, Real) and isfinite(each) for each in bounds):
            problems.append(f"action_low is {low!r} and action_high {high!r}, expected numbers")
        elif low is not None and high is not None and low > high:
            problems.append(f"action_low {low} is above action_high {high}")
        if problems:
            raise ConversionError("; ".join(problems))

    @classmethod
    def of(cls, *, agents: Any = None, **answers: Any) -> "Choices":
        """Choices by name; agents are a number, or names in a list or separated by commas.

        Raises:
            UnknownNameError: there is no such choice.
        """
        names = [each.name for each in fields(cls)]
        if unknown := answers.keys() - names:
            raise UnknownNameError("answer about foreign data", min(unknown), names)
        if isinstance(agents, str) and agents.isdecimal():
            return cls(n_agents=int(agents), **answers)
        if not isinstance(agents, Iterable | None):
            return cls(n_agents=agents, **answers)
        listed = agents.split(",") if isinstance(agents, str) else agents
        return cls(agents=None if listed is None else tuple(listed), **answers)

    @property
    def team_size(self) -> int | None:
        """Number of agents, if it or their names were given."""
        return self.n_agents if self.agents is None else len(self.agents)

    def given(self) -> list[str]:
        """Names of the answers that were given."""
        return [each.name for each in fields(self) if getattr(self, each.name) is not None]

    def answered(self) -> dict[str, str]:
        """The answers that were given, for the record."""
        names = ("time_limit", "episode_length", "final", "unfinished")
        values = {name: getattr(self, name) for name in names}
        return {name: str(value) for name, value in values.items() if value is not None}


def absolute_path(path: Path | str) -> Path:
    """The absolute path that is meant; `~` is a home folder, `~NAME` that of a known user."""
    try:
        return Path(path).expanduser().absolute()
    except RuntimeError as error:  # pathlib's, for a user without a home folder
        user = Path(path).parts[0]
        raise ConversionError(
            f"{str(path)!r}: {user!r} is no home folder of this machine. Write the whole path, or "
            f"'./{user}' for a folder of that name."
        ) from error
