"""Search spaces of settings: what `tune` draws from.

An algorithm declares its space beside its config, as `SPACE`: a table of the settings that depend
on the data, with an interval or a list of values for each. All other settings keep their defaults,
and so does the cost of an update, so that trials of an algorithm are equally long.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from swarmdata.errors import SchemaError
from swarmdata.numerics.random import derive, uniform

DIGITS = 3
"""Significant digits of a drawn number: more would not be told apart by any training."""


@dataclass(frozen=True, slots=True)
class LogUniform:
    """Numbers whose logarithm is uniform.

    Raises:
        SchemaError: the ends are not above 0 and in order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        """Checks the ends."""
        if not 0 < self.low < self.high < math.inf:
            raise SchemaError(f"{self}: expected finite ends above 0, the lower one first")

    def __contains__(self, value: Any) -> bool:
        """Whether a setting may have this value."""
        return bool(self.low <= value <= self.high)

    def at(self, share: float) -> float:
        """The number below which a share of the draws is, rounded to `DIGITS` and in the space."""
        value = self.low * (self.high / self.low) ** share
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)


@dataclass(frozen=True, slots=True)
class Choice:
    """One of some values, each as likely as the others."""

    values: tuple[Any, ...]

    def __contains__(self, value: Any) -> bool:
        """Whether a setting may have this value."""
        return value in self.values

    def at(self, share: float) -> Any:
        """The value at a share, in [0, 1), of the list."""
        return self.values[int(share * len(self.values))]


Space = Mapping[str, LogUniform | Choice]
"""By the name of the setting."""


def space_of(kind: Any, name: str) -> Space:
    """Returns the search space of an algorithm.

    Args:
        kind: the algorithm.
        name: that it is registered by.

    Raises:
        SchemaError: it declares none.
    """
    space: Space | None = getattr(kind, "SPACE", None)
    if not space:
        raise SchemaError(
            f"{name} declares no search space. Give its class an attribute SPACE: a table of "
            "settings with `swarmdata.LogUniform(low, high)` or `swarmdata.Choice((value, value))`."
        )
    return space


def drawn_settings(space: Space, seed: int) -> Iterator[dict[str, Any]]:
    """Yields random settings from a space without end; the first n are the same for every n.

    Args:
        space: to draw from.
        seed: of the draws.
    """
    trial = 0
    while True:
        yield {
            name: values.at(uniform(derive(seed, trial, index)).item())
            for index, (name, values) in enumerate(space.items())
        }
        trial += 1
