"""Steps to write into: small ones are made many at a time, since an array costs 0.3 us."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from swarmdata.types import Bool, Step

WRITTEN_FIELDS = (
    "observations", "states", "rewards", "terminations", "truncations", "successes", "events",
    "times",
)  # fmt: skip
"""Fields of a step that every step writes anew; a channel's are copied, the others shared."""

LASTING_FIELDS = ("observations", "terminations", "truncations", "successes")
"""Those of them that stay as they are in copies that have ended, and that `begin_step` leaves."""

BLOCK_BYTES = 1 << 15
"""Memory of the steps that are made at once. Who keeps one of them keeps them all."""

BLOCK_STEPS = 16


class StepMaker:
    """Makes steps of the shapes of one.

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
        """A step to fill in, with what only a reset changes, and a copy of what a channel wrote."""
        fresh = next(self._ready, None)
        if fresh is None:
            self._ready = zip(
                *(np.empty((self._n, *shape), dtype) for shape, dtype in self._like), strict=True
            )
            fresh = next(self._ready)
        observations, states, rewards, terminations, truncations, successes, events, times = fresh
        sent, delivered, ages = before.sent, before.delivered, before.ages
        if self._has_channel:
            sent, delivered, ages = sent.copy(), delivered.copy(), ages.copy()
        return Step(
            observations, states, rewards, terminations, truncations, successes, events,
            before.seeds, times, before.layouts, sent, delivered, ages,
        )  # fmt: skip


def keep_ended(before: Step, now: Step, active: Bool) -> None:
    """Copies what lasts in the copies that had ended."""
    ended = ~active
    for name in LASTING_FIELDS:
        getattr(now, name)[ended] = getattr(before, name)[ended]
