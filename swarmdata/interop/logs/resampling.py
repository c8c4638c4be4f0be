"""Samples of a signal at irregular times, in whole nanoseconds, and their values on a grid.

Nothing is extrapolated: a value between two samples is known if they are at most `max_gap` apart,
and a held value for at most `max_gap` after its sample.
"""

from dataclasses import dataclass

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.types import Bool, Double, Int

NANOSECONDS = 1_000_000_000

MOST_GRID_TIMES = 20_000_000
"""Most times of a grid: 23 days at 10 Hz. More come of a wrong unit or clock."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A signal as it was logged."""

    times: Int  # [n] ns, strictly increasing
    values: Double  # [n, F]

    def shifted(self, offset: int) -> "Samples":
        """The same values, each `offset` nanoseconds later."""
        return Samples(self.times + offset, self.values)


def nanoseconds(seconds: float) -> int:
    """A duration in whole nanoseconds."""
    return round(seconds * NANOSECONDS)


def make_grid(start: int, stop: int, dt: float) -> Int:
    """The times from `start` to `stop`, every `dt` seconds, [K] ns; ConversionError if too many."""
    step = nanoseconds(dt)
    n_times = (stop - start) // step + 1
    if n_times > MOST_GRID_TIMES:
        raise ConversionError(
            f"the poses span {(stop - start) / NANOSECONDS:,.0f} s, which are {n_times:,} steps of "
            f"{dt:g} s, expected at most {MOST_GRID_TIMES:,}. The unit of a time column or a "
            "clock_offset is wrong, or the logs are of different days: import them one by one."
        )
    return start + step * np.arange(n_times, dtype=np.int64)


def _neighbours(samples: Samples, grid: Int, max_gap: int) -> tuple[Int, Int, Bool]:
    """Indices of the samples around each time of a grid, and whether both exist and are near."""
    n = len(samples.times)
    before = np.searchsorted(samples.times, grid, side="right") - 1
    after = np.searchsorted(samples.times, grid, side="left")
    inside = (before >= 0) & (after < n)
    if not n:
        return before, after, inside
    before, after = before.clip(0, n - 1), after.clip(0, n - 1)
    inside &= samples.times[after] - samples.times[before] <= max_gap
    return before, after, inside


def interpolate(
    samples: Samples, grid: Int, max_gap: int, *, is_angle: bool = False
) -> tuple[Double, Bool]:
    """Values between samples on a straight line, [K, F], and whether they are known, [K].

    Angles go along the shorter arc and are in (-pi, pi] rad; of two opposite angles the arc goes
    counter-clockwise. Unknown values are 0.
    """
    values = np.zeros((len(grid), samples.values.shape[1]))
    before, after, known = _neighbours(samples, grid, max_gap)
    if known.any():
        before, after = before[known], after[known]
        span = samples.times[after] - samples.times[before]
        passed = grid[known] - samples.times[before]
        fractions = np.divide(passed, span, out=np.zeros(len(span)), where=span > 0)[:, None]
        first = samples.values[before]
        change = samples.values[after] - first
        found = first + fractions * (wrap(change) if is_angle else change)
        values[known] = wrap(found) if is_angle else found
    return values, known


def hold(samples: Samples, grid: Int, max_gap: int | None) -> tuple[Double, Bool]:
    """The newest sample at each time of a grid, [K] ns: values, [K, F], and whether known, [K].

    A sample holds for `max_gap` ns; None: until the next one.
    """
    values = np.zeros((len(grid), samples.values.shape[1]))
    newest = np.searchsorted(samples.times, grid, side="right") - 1
    known = newest >= 0
    if max_gap is not None and known.any():
        known &= grid - samples.times[newest.clip(0)] <= max_gap
    values[known] = samples.values[newest[known]]
    return values, known


def add_up(samples: Samples, grid: Int) -> Double:
    """The sum of the samples after each time up to and with the next one, [K - 1, F]."""
    sums = np.zeros((len(grid), samples.values.shape[1]))
    step = np.searchsorted(grid, samples.times, side="left") - 1
    inside = (step >= 0) & (step < len(grid) - 1)
    np.add.at(sums, step[inside], samples.values[inside])
    return sums[:-1]


def wrap(angles: Double) -> Double:
    """The same angles in (-pi, pi], rad."""
    wrapped: Double = np.pi - np.mod(np.pi - angles, 2 * np.pi)
    return wrapped
