"""Resampling: exact on lines, no jumps of headings, nothing known where samples are far apart."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.resampling import (
    NANOSECONDS,
    Samples,
    add_up,
    hold,
    interpolate,
    make_grid,
    wrap,
)

GAP = NANOSECONDS // 2

times = st.lists(st.integers(0, 20 * NANOSECONDS), min_size=2, max_size=60, unique=True).map(sorted)
grids = st.lists(st.integers(0, 20 * NANOSECONDS), min_size=1, max_size=40, unique=True).map(sorted)


def samples(when: list[int], values: np.ndarray) -> Samples:
    return Samples(np.array(when, np.int64), values.reshape(len(when), -1))


def near(when: list[int], time: int) -> bool:
    """Whether samples around a time are near, or one is at the time itself."""
    if time in when:
        return True
    before, after = [t for t in when if t < time], [t for t in when if t > time]
    return bool(before and after) and after[0] - before[-1] <= GAP


@given(times, grids, st.floats(-5, 5), st.floats(-5, 5))
def test_linear_motion_stays_exact(
    when: list[int], grid: list[int], start: float, speed: float
) -> None:
    seconds = np.array(when) / NANOSECONDS
    logged = samples(when, np.stack([start + speed * seconds, -speed * seconds], axis=1))
    values, known = interpolate(logged, np.array(grid), GAP)
    expected = np.array(grid) / NANOSECONDS
    assert_allclose(values[known, 0], start + speed * expected[known], atol=1e-9)
    assert_allclose(values[known, 1], -speed * expected[known], atol=1e-9)


@given(times, grids)
def test_gaps_are_unknown_and_nothing_else(when: list[int], grid: list[int]) -> None:
    logged = samples(when, np.ones(len(when)))
    for resample in (interpolate, partial(interpolate, is_angle=True)):
        values, known = resample(logged, np.array(grid), GAP)
        assert known.tolist() == [near(when, time) for time in grid]
        assert_array_equal(values[:, 0], np.where(known, values[:, 0], 0.0))


@given(times, grids, st.floats(-10, 10), st.floats(-3, 3))
def test_headings_turn_steadily_over_the_seam(
    when: list[int], grid: list[int], start: float, rate: float
) -> None:
    """Of a robot that turns less than half a turn between samples, on the circle."""
    seconds = np.array(when) / NANOSECONDS
    logged = samples(when, np.angle(np.exp(1j * (start + rate * seconds))))
    values, known = interpolate(logged, np.array(grid), GAP, is_angle=True)
    expected = start + rate * np.array(grid) / NANOSECONDS
    assert_allclose(wrap(values[known, 0] - expected[known] + 1) - 1, 0, atol=1e-8)
    assert (np.abs(values) <= np.pi + 1e-12).all()


@pytest.mark.slow
@given(times, st.lists(st.floats(-100, 100), min_size=60, max_size=60))
def test_headings_never_jump(when: list[int], angles: list[float]) -> None:
    """Between two samples no heading is farther from both than they are from each other."""
    logged = samples(when, np.array(angles[: len(when)]))
    grid = np.arange(when[0], when[-1], (when[-1] - when[0]) // 50 + 1)
    values, known = interpolate(logged, grid, GAP, is_angle=True)
    k = np.searchsorted(logged.times, grid, side="right") - 1
    last = np.minimum(k + 1, len(when) - 1)
    arc = np.abs(wrap(logged.values[last, 0] - logged.values[k, 0]))
    turned = np.abs(wrap(values[:, 0] - logged.values[k, 0]))
    assert (turned[known] <= arc[known] + 1e-9).all()


@given(times, grids)
def test_commands_are_held(when: list[int], grid: list[int]) -> None:
    logged = samples(when, np.arange(len(when), dtype=np.float64))
    values, known = hold(logged, np.array(grid), GAP)
    for time, value, is_known in zip(grid, values[:, 0], known, strict=True):
        before = [k for k, t in enumerate(when) if t <= time]
        assert is_known == (bool(before) and time - when[before[-1]] <= GAP)
        assert value == (before[-1] if is_known else 0)
    _, forever = hold(logged, np.array(grid), None)
    assert forever.tolist() == [time >= when[0] for time in grid]


@given(times)
def test_sums_lose_nothing(when: list[int]) -> None:
    grid = make_grid(when[0] - 1, when[-1] + NANOSECONDS, 0.3)
    sums = add_up(samples(when, np.ones(len(when))), grid)
    assert sums.sum() == len(when)
    inside = [t for t in when if grid[0] < t <= grid[1]]
    assert sums[0, 0] == len(inside)


def test_a_grid_of_a_wrong_unit_is_refused() -> None:
    with pytest.raises(ConversionError, match="The unit of a time column"):
        make_grid(0, 10**9 * NANOSECONDS, 0.01)
