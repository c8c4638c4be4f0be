"""Data that this library did not write: from timelines, spaces by shape and the user's choices."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.interop.conversion.episode_cuts import Span, Timeline, pieces, spans_of
from swarmdata.interop.conversion.incoming import (
    UNKNOWN,
    Incoming,
    Shapes,
    episode_of,
    measured_spec,
)
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.recipe import PolicySource
from swarmdata.types import Bool, Episode, Float


def unnoted(
    task: str,
    shapes: Shapes,
    timelines: Sequence[Timeline],
    choices: Choices,
    policies: tuple[PolicySource, ...] | None = None,
) -> Incoming:
    """Takes in data that this library did not write.

    Seeds are the numbers of the episodes: the data has none.

    Args:
        task: name of the environment.
        shapes: of its agents.
        timelines: the data.
        choices: what the user says about it.
        policies: who acted, one for each timeline; None: nobody knows.

    Raises:
        ConversionError: the data is ambiguous and `choices` does not answer; when an episode is
            taken, that its arrays do not fit together.
    """
    spans = spans_of(timelines, choices)
    dropped = sum(map(len, timelines)) - sum(len(span) for each in spans for span in each)
    metadata = {"seeds": "numbers of the episodes", **choices.answered()}
    if dropped:
        metadata["dropped_rows"] = str(dropped)
    leaves = any(_leave_early(t, each) for t, each in zip(timelines, spans, strict=True))

    def episodes() -> Iterator[Episode]:
        number = 0
        for index, (timeline, each) in enumerate(zip(timelines, spans, strict=True)):
            for rows, span in pieces(timeline, each, choices):
                if "states" not in rows:
                    rows["states"] = _joined_observations(rows["observations"], shapes)
                if leaves:
                    rows.update(_leaving(timeline, span))
                    _mask_the_dead(rows)
                policy = index if policies else 0
                yield episode_of(rows, seed=number, policy=policy, end=span.end)
                number += 1

    spec = measured_spec(task, shapes, choices)
    return Incoming(spec, policies or UNKNOWN, episodes(), None, metadata)


def _leave_early(timeline: Timeline, spans: Sequence[Span]) -> bool:
    """Whether some agent ends before its team does."""
    flags = timeline.terminals
    if timeline.truncations is not None:
        flags = flags | timeline.truncations
    before_last = np.ones(len(timeline), dtype=np.bool_)
    before_last[[span.stop - 1 for span in spans]] = False
    return bool(flags[before_last].any())


def _joined_observations(observations: Float, shapes: Shapes) -> Float:
    """The state of an environment that has none: all observations, without padding."""
    widths = enumerate(shapes.observations)
    return np.concatenate([observations[:, agent, :width] for agent, width in widths], axis=1)


def _leaving(timeline: Timeline, span: Span) -> dict[str, NDArray[Any]]:
    """Who is there when, from flags that stay up or not after an agent has left."""
    window = slice(span.start, span.stop)
    terminated = timeline.terminals[window]
    cut = np.zeros_like(terminated)
    if timeline.truncations is not None:
        cut = timeline.truncations[window] & ~terminated
    gone = np.logical_or.accumulate(terminated | cut, axis=0)
    alive = np.ones((len(span) + 1, terminated.shape[1]), dtype=np.bool_)
    alive[1:] = ~gone
    return {
        "alive": alive,
        "agent_terminations": terminated & alive[:-1],
        "agent_truncations": cut & alive[:-1],
    }


def _mask_the_dead(rows: dict[str, NDArray[Any]]) -> None:
    """Zeroes what agents that left would have seen and done, as every dataset here has it."""
    alive: Bool = rows["alive"]
    rows["observations"] = rows["observations"] * _before_end(alive)[..., None]
    rows["actions"] = rows["actions"] * alive[:-1, :, None]
    rows["rewards"] = rows["rewards"] * alive[:-1]


def _before_end(alive: Bool) -> Bool:
    """Who sees a state: agents that are there, and those that left by reaching it."""
    seen = alive.copy()
    seen[1:] |= alive[:-1]
    return seen
