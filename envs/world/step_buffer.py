"""Allocates the steps of an environment, many at a time since one array costs 0.3 us."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Counts, Float, Int, Seeds, Step

WRITTEN_FIELDS = (
    "observations", "states", "rewards", "reward_terms", "terminations", "truncations", "successes",
    "events", "times",
)  # fmt: skip
"""Fields that every step writes from scratch; those of a channel are copied, the others shared."""

LASTING_FIELDS = ("observations", "terminations", "truncations", "successes")
"""Those that `keep_ended` copies where an episode has ended; `begin_step` handles the rest."""

BLOCK_BYTES = 1 << 15
"""Memory of the steps that are allocated together; keeping one of them keeps them all."""

BLOCK_STEPS = 16


class StepMaker:
    """Makes steps with the shapes of another.

    Args:
        like: a step of the environment.
    """

    def __init__(self, like: Step) -> None:
        arrays = [getattr(like, name) for name in WRITTEN_FIELDS]
        self._like = [(array.shape, array.dtype) for array in arrays]
        size = sum(array.nbytes for array in arrays)
        self._n = min(max(BLOCK_BYTES // size, 1), BLOCK_STEPS)
        self._has_channel = like.ages.size > 0
        self._ready: Iterator[tuple[Any, ...]] = iter(())

    def after(self, before: Step) -> Step:
        """Returns a step to fill in; it shares with `before` the fields that only resets change."""
        fresh = next(self._ready, None)
        if fresh is None:
            self._ready = zip(
                *(np.empty((self._n, *shape), dtype) for shape, dtype in self._like), strict=True
            )
            fresh = next(self._ready)
        (
            observations, states, rewards, terms, terminations, truncations, successes, events,
            times,
        ) = fresh  # fmt: skip
        sent, delivered, ages = before.sent, before.delivered, before.ages
        if self._has_channel:
            sent, delivered, ages = sent.copy(), delivered.copy(), ages.copy()
        return Step(
            observations, states, rewards, terms, terminations, truncations, successes, events,
            before.seeds, times, before.layouts, sent, delivered, ages,
        )  # fmt: skip


@kernel
def clear_copies(
    copies: Int,
    new_seeds: Seeds,
    seeds: Seeds,
    times: Int,
    rewards: Float,
    terms: Float,
    events: Counts,
    terminations: Bool,
    truncations: Bool,
    successes: Bool,
    fresh: Bool,
) -> None:
    """Writes the fields of a step that say nothing yet in copies where an episode begins.

    Args:
        copies: rows, [C].
        new_seeds: of the episodes, [C].
        seeds: written, [E].
        times: written: 0, [E].
        rewards: written: 0, [E, N].
        terms: written: 0, [E, N, R].
        events: written: 0, [E, N, 4].
        terminations: written: false, [E].
        truncations: written: false, [E].
        successes: written: false, [E].
        fresh: written: true, [E].
    """
    for row in range(copies.shape[0]):
        b = copies[row]
        seeds[b], times[b], fresh[b] = new_seeds[row], 0, True
        rewards[b], terms[b], events[b] = 0.0, 0.0, 0
        terminations[b], truncations[b], successes[b] = False, False, False


def keep_ended(before: Step, now: Step, active: Bool) -> None:
    """Carries the values of `LASTING_FIELDS` over in the copies that had already ended."""
    ended = ~active
    for name in LASTING_FIELDS:
        getattr(now, name)[ended] = getattr(before, name)[ended]
