"""Differences between rows: signs, verdicts, and which budget is long enough."""

from math import nan

import pytest

from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    _enough,
    format_difference,
    verdict_of,
)
from swarmdata.rollouts.score_statistics import Estimate

SCORE = Column("score", "score", "", 1)


def change(low: float, high: float, dataset: str = "x") -> RowDifference:
    return RowDifference("a-2x", "a-1x", dataset, {"score": Estimate((low + high) / 2, low, high)})


@pytest.mark.parametrize(
    ("ends", "verdict", "text"),
    [
        ((1.0, 3.0), "higher", "+2.0 [1.0, 3.0]"),
        ((-3.0, -1.0), "lower", "−2.0 [−3.0, −1.0]"),
        ((-1.0, 2.0), "no clear change", "+0.5 [−1.0, 2.0]"),
        ((0.0, 0.0), "no clear change", "0.0 [0.0, 0.0]"),
        ((nan, nan), "no clear change", "–"),
    ],
)
def test_a_difference_is_clear_if_its_whole_interval_is(
    ends: tuple[float, float], verdict: str, text: str
) -> None:
    found = change(*ends).estimates["score"]
    assert verdict_of(found) == verdict
    assert format_difference(found, SCORE) == text


def test_the_shortest_budget_passes_with_all_longer_ones() -> None:
    clear, unclear = change(1, 2), change(-3, 1, "y")
    assert _enough({10: [change(-1, 2)], 20: [unclear]}, SCORE) == ("10", "")
    text = "10 updates: +1.5 [1.0, 2.0] on x"
    assert _enough({10: [clear], 20: [unclear]}, SCORE) == ("20", text)
    assert _enough({10: [unclear], 20: [clear]}, SCORE)[0] == "–", "the longest one changes it"
