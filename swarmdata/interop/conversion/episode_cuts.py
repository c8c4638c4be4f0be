"""Cuts flat timelines of foreign data into episodes; ambiguous ends are errors."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import NEXT_PREFIX, STATE_ARRAYS
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.types import Bool

ReadRows = Callable[[slice], Mapping[str, NDArray[Any]]]
"""Reads a slice of rows, by the names of an episode's fields.

Arrays over states may come with those after each step (`NEXT_PREFIX`); otherwise the last state of
an episode is unknown."""

End = Literal["termination", "truncation"]


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Consecutive steps of several episodes, one row per step.

    Attributes:
        name: a file, or a row of one; for errors.
        terminals: which agents terminated in a step, [n, N].
        truncations: which agents were truncated in a step, [n, N]; None: not in the format.
        read: reads the arrays of some rows.
        has_next: whether `read` gives the observations after each step.
    """

    name: str
    terminals: Bool
    truncations: Bool | None
    read: ReadRows
    has_next: bool

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.terminals)


@dataclass(frozen=True, slots=True)
class Span:
    """The rows of one episode, and how it ended."""

    start: int
    stop: int
    end: End

    def __len__(self) -> int:
        """Number of steps."""
        return self.stop - self.start


def find_spans(timelines: Sequence[Timeline], choices: Choices) -> list[list[Span]]:
    """Finds the episodes of each timeline, by its flags and the user's choices.

    Raises:
        ConversionError: the data do not tell where episodes end, or why.
    """
    found = [_spans(timeline, choices) for timeline in timelines]
    for timeline, spans in zip(timelines, found, strict=True):
        if not spans:
            raise ConversionError(f"{timeline.name} has no whole episode, expected at least 1")
    _refuse_hidden_limit(timelines, found, choices)
    return found


def _spans(timeline: Timeline, choices: Choices) -> list[Span]:
    terminated: Bool = np.asarray(timeline.terminals.all(axis=1))
    ended: Bool = terminated
    if timeline.truncations is not None:
        ended = np.asarray((timeline.terminals | timeline.truncations).all(axis=1))
    elif choices.time_limit is None and choices.episode_length is None:
        raise ConversionError(
            f"{timeline.name} does not say which episodes a time limit truncated, so terminations "
            "and truncations look the same. Pass time_limit=STEPS, time_limit=0 if there is no "
            "limit, or episode_length=STEPS if all episodes have the same length."
        )
    ends = _ends(timeline, ended, choices)
    starts = [0, *ends[:-1]]
    spans = []
    for start, stop in zip(starts, ends, strict=True):
        # an episode that terminates exactly at the time limit was truncated
        is_terminated = terminated[stop - 1] and stop - start != choices.time_limit
        if stop > start:
            spans.append(Span(start, stop, "termination" if is_terminated else "truncation"))
    return spans + _tail(timeline, ends[-1] if ends else 0, choices)


def _ends(timeline: Timeline, ended: Bool, choices: Choices) -> list[int]:
    """The row after each episode."""
    n, length = len(timeline), choices.episode_length
    flagged = (np.flatnonzero(ended) + 1).tolist()
    if length is not None:
        inside = [end for end in flagged if end % length]
        if inside:
            raise ConversionError(
                f"{timeline.name} has an end at row {inside[0] - 1}, which is inside an episode of "
                f"episode_length={length} steps. Pass the right length, or none to use the flags."
            )
        return list(range(length, n + 1, length))
    if timeline.truncations is not None or not choices.time_limit:
        return flagged
    ends: list[int] = []  # without flags of truncations, steps are counted
    for stop in [*flagged, n]:
        start = ends[-1] if ends else 0
        ends += range(start + choices.time_limit, stop + 1, choices.time_limit)
        if stop in flagged and (not ends or ends[-1] < stop):
            ends.append(stop)
    return ends


def _tail(timeline: Timeline, start: int, choices: Choices) -> list[Span]:
    left = len(timeline) - start
    if not left or choices.unfinished == "drop":
        return []
    if choices.unfinished == "truncate":
        return [Span(start, len(timeline), "truncation")]
    raise ConversionError(
        f"{timeline.name} has {left} rows from row {start} on without an end for all agents, "
        "expected the last row to end an episode. Pass unfinished='truncate' to keep them as a "
        "truncated episode, unfinished='drop' to leave them out, or episode_length=STEPS if the "
        "flags mean nothing."
    )


def _refuse_hidden_limit(
    timelines: Sequence[Timeline], found: Sequence[Sequence[Span]], choices: Choices
) -> None:
    """Refuses data in which a time limit was probably stored as a termination.

    OMAR's particle data and OG-MARL's older wrappers store it so; a learner would then assume a
    value of zero after the limit.
    """
    if choices.time_limit is not None or choices.episode_length is not None:
        return
    spans = [span for each in found for span in each]
    lengths = {len(span) for span in spans}
    if len(spans) > 1 and len(lengths) == 1 and {span.end for span in spans} == {"termination"}:
        (length,) = lengths
        raise ConversionError(
            f"all {len(spans)} episodes of {timelines[0].name} terminate after exactly {length} "
            f"steps, as if a time limit had been stored as a termination. Pass time_limit={length} "
            "if there is this limit, or time_limit=0 if the task ends then."
        )


def cut_episodes(
    timeline: Timeline, spans: Sequence[Span], choices: Choices
) -> Iterator[tuple[dict[str, NDArray[Any]], Span]]:
    """Yields the arrays of each episode, states with T + 1 rows, and its span.

    Raises:
        ConversionError: a state after a step differs from the state before the next one, or the
            last state is missing and there is no choice about it.
    """
    for span in spans:
        kept = span
        if not timeline.has_next and choices.final is None:
            raise ConversionError(
                f"{timeline.name} lacks the observation after the last action of each episode. "
                "Pass final='repeat' to repeat the one before it, or final='cut' to do so for "
                "terminated episodes only and to drop the last step of truncated ones."
            )
        if not timeline.has_next and choices.final == "cut" and span.end == "truncation":
            if len(span) == 1:
                continue
            kept = Span(span.start, span.stop - 1, span.end)
        rows = timeline.read(slice(span.start, span.stop))
        yield _with_last_state(timeline, dict(rows), kept), kept


def _with_last_state(
    timeline: Timeline, rows: dict[str, NDArray[Any]], span: Span
) -> dict[str, NDArray[Any]]:
    n = len(span)
    keys = {name: NEXT_PREFIX + name for name in STATE_ARRAYS}
    after = {name: rows.pop(key) for name, key in keys.items() if key in rows}
    whole = {}
    for name, values in rows.items():
        if name not in STATE_ARRAYS:
            whole[name] = values[:n]
        elif name in after:
            check_continues(
                name, values[:n], after[name][:n], timeline.name, span.start,
                "The rows are shuffled, or an episode ends there: pass time_limit or "
                "episode_length.",
            )  # fmt: skip
            whole[name] = np.concatenate([values[:n], after[name][n - 1 : n]])
        else:
            last = values[n : n + 1] if len(values) > n else values[n - 1 :]
            whole[name] = np.concatenate([values[:n], last])
    return whole


def check_continues(
    name: str, before: NDArray[Any], after: NDArray[Any], source: str, start: int, advice: str
) -> None:
    """Checks that each state after a step is the state before the next one.

    Args:
        name: name of the states.
        before: states before the T steps of an episode, [T, ...].
        after: states after them, [T, ...].
        source: name of the source, for the error.
        start: number of the episode's first row in it, for the error.
        advice: last sentence of the error.

    Raises:
        ConversionError: two states differ.
    """
    same = (after[:-1] == before[1:]).all(axis=tuple(range(1, after.ndim)))
    if not same.all():
        row = start + int(np.argmin(same))
        raise ConversionError(
            f"{source}: {NEXT_PREFIX}{name} of row {row} differs from {name} of row {row + 1}, "
            f"though both belong to one episode. {advice}"
        )
