"""Imports data that this library did not write, with the user's choices."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import quoted
from swarmdata.interop.conversion.episode_cuts import (
    Span,
    Timeline,
    agent_ends,
    cut_episodes,
    find_spans,
)
from swarmdata.interop.conversion.imported_data import (
    UNKNOWN_POLICIES,
    AgentShapes,
    ImportedData,
    build_episode,
    spec_from_shapes,
)
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.recipe import PolicySource
from swarmdata.types import Episode

MOST_UNREAD = 20
"""Arrays without a place that a card names."""


def import_without_note(
    task: str,
    shapes: AgentShapes,
    timelines: Sequence[Timeline],
    choices: Choices,
    policies: tuple[PolicySource, ...] | None = None,
    unread: Sequence[str] = (),
) -> ImportedData:
    """Imports data that this library did not write.

    Such data have no seeds, so the episodes' numbers take their place.

    Args:
        task: name of the environment.
        shapes: sizes of its agents.
        timelines: the data.
        choices: the user's answers about it.
        policies: behavior policies, one for each timeline; None: unknown.
        unread: arrays of the data that no array of ours takes, for the card.

    Raises:
        ConversionError: the data are ambiguous and `choices` has no answer; or, when an episode is
            taken, its arrays do not fit together.
        SchemaError: when an episode is taken, a number is not finite, or float32 does not hold it.
    """
    spans = find_spans(timelines, choices)
    dropped = sum(map(len, timelines)) - sum(len(span) for each in spans for span in each)
    metadata = {"seeds": "numbers of the episodes", **choices.answered()}
    if dropped:
        metadata["dropped_rows"] = str(dropped)
    metadata |= unread_note(unread)
    leaves = any(_leave_early(t, each) for t, each in zip(timelines, spans, strict=True))

    def episodes() -> Iterator[Episode]:
        number = 0
        for index, (timeline, each) in enumerate(zip(timelines, spans, strict=True)):
            for rows, span in cut_episodes(timeline, each):
                if "states" not in rows:
                    widths = enumerate(shapes.observations)  # without padding
                    rows["states"] = np.concatenate(
                        [rows["observations"][:, k, :width] for k, width in widths], axis=1
                    )
                if leaves:
                    _mark_leaving(rows, timeline, span)
                policy = index if policies else 0
                yield build_episode(rows, seed=number, policy=policy, end=span.end)
                number += 1

    spec = spec_from_shapes(task, shapes, choices)
    return ImportedData(spec, policies or UNKNOWN_POLICIES, episodes(), None, metadata)


def unread_note(names: Sequence[str]) -> dict[str, str]:
    """What a card says of arrays that no array of ours takes."""
    shown, n_more = sorted(names)[:MOST_UNREAD], len(names) - MOST_UNREAD
    if not shown:
        return {}
    more = f" and {n_more} more" if n_more > 0 else ""
    return {"unread_arrays": ", ".join(map(quoted, shown)) + more}


def _leave_early(timeline: Timeline, spans: Sequence[Span]) -> bool:
    """Whether some agent ends before its team, or otherwise than its team."""
    if timeline.terminals.shape[1] == 1:
        return False
    for span in spans:
        terminated, cut = agent_ends(timeline, span)
        is_early = bool((terminated | cut)[:-1].any())
        if is_early or (terminated[-1].any() and cut[-1].any()):
            return True
    return False


def _mark_leaving(rows: dict[str, NDArray[Any]], timeline: Timeline, span: Span) -> None:
    """Adds which agents are alive, and zeroes the values of agents that have left."""
    terminated, cut = agent_ends(timeline, span)
    alive = np.ones((len(span) + 1, terminated.shape[1]), dtype=np.bool_)
    alive[1:] = ~np.logical_or.accumulate(terminated | cut, axis=0)
    rows["alive"] = alive
    rows["agent_terminations"], rows["agent_truncations"] = terminated, cut
    seen = alive.copy()
    seen[1:] |= alive[:-1]  # an agent also observes the state in which it leaves
    rows["observations"] = rows["observations"] * seen[..., None]
    rows["actions"] = rows["actions"] * alive[:-1, :, None]
    rows["rewards"] = rows["rewards"] * alive[:-1]
