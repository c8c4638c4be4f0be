"""Imports data that this library did not write, cut into episodes; ambiguous ends are errors."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ConversionError, quoted
from swarmdata.interop.conversion.dataset_facts import (
    BLOCK_BYTES,
    NEXT_PREFIX,
    STATE_ARRAYS,
    Arrays,
)
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import admit_rows
from swarmdata.interop.conversion.imported_data import (
    UNKNOWN_POLICIES,
    AgentShapes,
    ImportedData,
    build_episode,
    leaving,
    spec_from_shapes,
)
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.specs.origins.recording_origin import NUMBERED_SEEDS
from swarmdata.specs.recipe import PolicySource
from swarmdata.types import Bool, Episode

MOST_UNREAD = 20  # arrays without a place that a card names

ReadRows = Callable[[slice], Arrays]
"""Reads a slice of rows, by the names of an episode's fields, as `admit_rows` takes them.

Arrays over states may come with those after each step (`NEXT_PREFIX`); otherwise the last state of
an episode is unknown."""

End = Literal["termination", "truncation"]


@dataclass(frozen=True, eq=False)
class Timeline:
    """Consecutive steps of several episodes, one row per step.

    An agent has ended from its first flag in an episode on, whether flags stay set or not; the
    episode ends when all have.
    """

    name: str  # a file, or a row of one; for errors
    terminals: Bool  # which agents terminated in a step, [n, N]
    truncations: Bool | None
    """Which agents were truncated in a step, [n, N]; None: not in the format."""
    read: ReadRows  # reads the arrays of some rows
    has_next: bool  # whether `read` gives the observations after each step

    def __len__(self) -> int:
        return len(self.terminals)

    @cached_property
    def flags(self) -> Bool:
        """Which agents have a flag in a step, [n, N]."""
        return self.terminals if self.truncations is None else self.terminals | self.truncations


@dataclass(frozen=True, slots=True)
class Span:
    """The rows of one episode, and how it ended."""

    start: int
    stop: int
    end: End
    at_limit: bool = False  # its last step is that of the time limit, whatever the flags say
    is_cut: bool = False  # the row after the last is of this episode, too

    def __len__(self) -> int:
        return self.stop - self.start


def find_spans(timelines: Sequence[Timeline], choices: Choices) -> list[list[Span]]:
    """The episodes of each timeline; ConversionError if the data do not tell where they end."""
    found = [_spans(timeline, choices) for timeline in timelines]
    _refuse_hidden_limit(timelines, found, choices)
    return [_kept(*each, choices) for each in zip(timelines, found, strict=True)]


def _spans(timeline: Timeline, choices: Choices) -> list[Span]:
    if (
        timeline.truncations is None
        and choices.time_limit is None
        and choices.episode_length is None
    ):
        raise ConversionError(
            f"{timeline.name} does not say which episodes a time limit truncated, so terminations "
            "and truncations look the same. Pass time_limit=STEPS, time_limit=0 if there is no "
            "limit, or episode_length=STEPS if all episodes have the same length."
        )
    cut = timeline.truncations
    asked = choices.time_limit is None and cut is not None and cut.any()
    if asked and timeline.terminals[cut].all():
        raise ConversionError(
            f"{timeline.name} has a termination wherever it has a truncation, so terminations may "
            "stand for ends of both kinds. Pass time_limit=0 if they are right, or "
            "time_limit=STEPS."
        )
    edges = [0, *_ends(timeline, choices)]
    spans = [_span(timeline, *rows, choices) for rows in pairwise(edges)]
    return spans + _tail(timeline, edges[-1], choices)


def _span(timeline: Timeline, start: int, stop: int, choices: Choices) -> Span:
    """The episode of some rows: truncated if any agent was in its last step, as in a recording."""
    if choices.time_limit and stop - start > choices.time_limit:
        raise ConversionError(
            f"{timeline.name} has an episode of {stop - start} steps in rows {start} to {stop - 1},"
            f" longer than time_limit={choices.time_limit}. Pass the right limit, or time_limit=0."
        )
    before = timeline.flags[start : stop - 1].any(axis=0)
    terminates = bool((before | timeline.terminals[stop - 1]).all())
    at_limit = stop - start == choices.time_limit  # then it was truncated
    is_terminated = terminates and not before.all() and not at_limit
    return Span(start, stop, "termination" if is_terminated else "truncation", at_limit)


def _kept(timeline: Timeline, spans: Sequence[Span], choices: Choices) -> list[Span]:
    """The episodes whose last observation is known or may be made up; there has to be one."""
    if not timeline.has_next and choices.final is None:
        raise ConversionError(
            f"{timeline.name} lacks the observation after the last action of each episode. "
            "Pass final='repeat' to repeat the one before it, or final='cut' to do so for "
            "terminated episodes only and to drop the last step of truncated ones."
        )
    kept = []
    for each in spans:
        is_cut = not timeline.has_next and choices.final == "cut" and each.end == "truncation"
        shorter = Span(each.start, each.stop - 1, each.end, is_cut=True) if is_cut else each
        kept += [shorter] if len(shorter) else []
    if not kept:
        raise ConversionError(f"{timeline.name} has no whole episode, expected at least 1")
    return kept


def agent_ends(timeline: Timeline, span: Span) -> tuple[Bool, Bool]:
    """In which steps of an episode agents were terminated and truncated, [T, N] each.

    Whoever has no flag when the episode ends was truncated then.
    """
    window = slice(span.start, span.stop)
    gone = np.logical_or.accumulate(timeline.flags[window], axis=0)
    first = gone.copy()
    first[1:] &= ~gone[:-1]
    terminated: Bool = timeline.terminals[window] & first
    cut: Bool = first & ~terminated
    cut[-1] |= ~gone[-1]
    if span.at_limit:
        cut[-1] |= terminated[-1]
        terminated[-1] = False
    return terminated, cut


def _ends(timeline: Timeline, choices: Choices) -> list[int]:
    """The row after each episode."""
    n, length = len(timeline), choices.episode_length
    if length is not None:
        for start in range(0, n, length):
            inner = timeline.flags[start : start + length - 1]
            ended = np.logical_or.accumulate(inner, axis=0).all(axis=1)
            if ended.any():
                raise ConversionError(
                    f"{timeline.name} has an end at row {start + int(np.argmax(ended))}, which is "
                    f"inside an episode of episode_length={length} steps. Pass the right length, "
                    "or none to use the flags."
                )
        return list(range(length, n + 1, length))
    flagged = _flagged_ends(timeline.flags)
    if timeline.truncations is not None or not choices.time_limit:
        return flagged
    ends: list[int] = []  # without flags of truncations, steps are counted
    for stop in [*flagged, n]:
        start = ends[-1] if ends else 0
        ends += range(start + choices.time_limit, stop + 1, choices.time_limit)
        if stop in flagged and (not ends or ends[-1] < stop):
            ends.append(stop)
    return ends


def _flagged_ends(flags: Bool) -> list[int]:
    """The row after each episode that ends when every agent has had a flag in it."""
    n = len(flags)
    rows, last = np.arange(n), np.zeros(n, dtype=np.int64)
    for agent in range(flags.shape[1]):
        upcoming = np.minimum.accumulate(np.where(flags[:, agent], rows, n)[::-1])[::-1]
        np.maximum(last, upcoming, out=last)  # of an episode that begins in the row
    ends = [0]
    while ends[-1] < n and last[ends[-1]] < n:
        ends.append(int(last[ends[-1]]) + 1)
    return ends[1:]


def _tail(timeline: Timeline, start: int, choices: Choices) -> list[Span]:
    left = len(timeline) - start
    if not left or choices.unfinished == "drop":
        return []
    if choices.unfinished == "truncate":
        return [_span(timeline, start, len(timeline), choices)]
    raise ConversionError(
        f"{timeline.name} has {left} rows from row {start} on without an end for all agents, "
        "expected the last row to end an episode. Pass unfinished='truncate' to keep them as a "
        "truncated episode, unfinished='drop' to leave them out, or episode_length=STEPS if the "
        "flags mean nothing."
    )


def _refuse_hidden_limit(
    timelines: Sequence[Timeline], found: Sequence[Sequence[Span]], choices: Choices
) -> None:
    """Refuses time limits stored as terminations, as in OMAR's particle data and old OG-MARL."""
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


def _rows_of(timeline: Timeline, span: Span) -> dict[str, NDArray[Any]]:
    """The arrays of an episode, states with T + 1 rows."""
    where = f"{timeline.name}, rows {span.start} to {span.stop - 1}"
    rows = timeline.read(slice(span.start, span.stop + span.is_cut))
    ours = admit_rows(rows, timeline.terminals.shape[1], where)
    advice = "The rows are shuffled, or an episode ends there: pass time_limit or episode_length."
    return join_states(ours, len(span), timeline.name, span.start, advice)


def join_states(
    rows: Arrays, n: int, source: str, start: int, advice: str
) -> dict[str, NDArray[Any]]:
    """Joins states before and after each of the n steps of an episode, to n + 1 rows.

    Where those after steps are unknown, the last one is that of a further row, or repeated. Where
    they differ from those before the next step, a ConversionError ends with `advice`; `start` is
    the number of the episode's first row in the source.
    """
    whole = {}
    for name, values in rows.items():
        if name.startswith(NEXT_PREFIX):
            continue
        whole[name] = before = values[:n]
        if name not in STATE_ARRAYS:
            continue
        last = values[-1:]
        if (after := rows.get(NEXT_PREFIX + name)) is not None:
            last = after[n - 1 : n]
            same = (after[: n - 1] == before[1:]).all(axis=tuple(range(1, after.ndim)))
            if not same.all():
                row = start + int(np.argmin(same))
                raise ConversionError(
                    f"{source}: {NEXT_PREFIX}{name} of row {row} differs from {name} of row "
                    f"{row + 1}, though both belong to one episode. {advice}"
                )
        whole[name] = np.concatenate([before, last])
    return whole


class BlockReader:
    """A `ReadRows` that reads many rows at once and serves small slices, in increasing order.

    The approximate size of a row bounds the memory; whatever `read` raises becomes an error of ours
    about `source`.
    """

    def __init__(self, read: ReadRows, n_rows: int, row_bytes: int, source: Path | str) -> None:
        self._read, self._source = read, source
        self._n_rows = n_rows
        self._block = max(1, BLOCK_BYTES // max(1, row_bytes))
        self._held: Arrays = {}
        self._start = self._stop = 0

    def __call__(self, window: slice) -> Arrays:
        """Returns the rows of `window`, which has a start and a stop."""
        if not self._start <= window.start <= window.stop <= self._stop:
            self._start = window.start
            self._stop = min(self._n_rows, max(window.stop, window.start + self._block))
            with reading(self._source):
                self._held = self._read(slice(self._start, self._stop))
        inside = slice(window.start - self._start, window.stop - self._start)
        return {name: np.asarray(values[inside]) for name, values in self._held.items()}


def import_without_note(
    task: str,
    shapes: AgentShapes,
    timelines: Sequence[Timeline],
    choices: Choices,
    policies: tuple[PolicySource, ...] | None = None,
    unread: Sequence[str] = (),
) -> ImportedData:
    """Imports data that this library did not write, which have episodes' numbers for seeds.

    Policies are those of each timeline, None if unknown; `unread` are arrays that no array of ours
    takes, for the card.

    Raises:
        ConversionError: the data are ambiguous and `choices` has no answer; or, when an episode is
            taken, its arrays do not fit together.
        SchemaError: when an episode is taken, a number is not finite, or float32 does not hold it.
    """
    spans = find_spans(timelines, choices)
    dropped = sum(map(len, timelines)) - sum(len(span) for each in spans for span in each)
    metadata = {**NUMBERED_SEEDS, **choices.answered()}
    if dropped:
        metadata["dropped_rows"] = str(dropped)
    metadata |= unread_note(unread)
    leaves = any(_leave_early(t, each) for t, each in zip(timelines, spans, strict=True))

    def episodes() -> Iterator[Episode]:
        number = 0
        for index, (timeline, each) in enumerate(zip(timelines, spans, strict=True)):
            for span in each:
                rows = _rows_of(timeline, span)
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
    acting = np.ones_like(terminated)
    acting[1:] = ~np.logical_or.accumulate(terminated | cut, axis=0)[:-1]
    rows |= leaving(acting, terminated)
    seen = rows["alive"].copy()
    seen[1:] |= acting  # an agent also observes the state in which it leaves
    rows["observations"] = rows["observations"] * seen[..., None]
    rows["actions"] = rows["actions"] * acting[..., None]
    rows["rewards"] = rows["rewards"] * acting
