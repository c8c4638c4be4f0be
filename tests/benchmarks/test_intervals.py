"""Intervals cover new training seeds and new episodes, which those of seeds alone do not."""

import pytest

from tests.benchmarks.bench_intervals import (
    METHODS,
    SETTINGS,
    Coverage,
    Method,
    Setting,
    bootstrap_of_seeds,
    coverage,
    of_seeds_and_episodes,
    t_of_seeds,
    text,
)

CASES = (Setting(5, 200, 3.0), Setting(5, 200, 3.0, shared_by_seeds=0.6), Setting(3, 200, 3.0))
N_DRAWS = 1500
WANTED = {5: 0.93, 3: 0.90}
"""Least coverage by the number of seeds. The standard error of 1,500 draws is 0.006 to 0.008."""


def is_wide_enough(setting: Setting, found: Coverage) -> bool:
    return min(found.mean, found.difference) >= WANTED[setting.n_seeds]


@pytest.mark.parametrize("setting", CASES)
def test_intervals_cover_means_and_differences(setting: Setting) -> None:
    found = coverage(setting, of_seeds_and_episodes, N_DRAWS)
    assert is_wide_enough(setting, found), found
    assert max(found.mean, found.difference) < 0.99  # nor are they far too wide


@pytest.mark.parametrize("method", [bootstrap_of_seeds, t_of_seeds])
def test_intervals_of_seeds_alone_would_fail(method: Method) -> None:
    found = coverage(CASES[1], method, 400)
    assert not is_wide_enough(CASES[1], found), found


def test_the_page_has_a_column_for_each_interval() -> None:
    page = text(10, [("5 seeds", "3", *("95 (1.0)",) * (2 * len(METHODS)))])
    assert page.count("seeds and episodes") == 3  # in the text, of means, of differences
    assert len(SETTINGS) == 20
