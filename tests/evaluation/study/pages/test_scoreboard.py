"""Scoreboards and differences between rows: who is best, and who is not clearly worse."""

from collections.abc import Mapping
from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.evaluation.results.estimate_table import Column, to_csv
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    _enough,
    format_difference,
    verdict_of,
)
from swarmdata.evaluation.study.pages.safety import pareto_optimal
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.evaluation.study.pages.study_tables import duration, scoreboard_table
from swarmdata.rollouts.score_intervals import difference_interval, mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.measured import at

FAMILIES = {"bc": "cloning", "vdn": "values", "qmix": "values", "omar": "critics"}
HARD = np.array([-2.0, -1.0, 1.0, 2.0])  # how episodes differ
SCORE = Column("score", "score", "", 1)


def make_board(
    scores: Mapping[str, Mapping[str, float]], data: Mapping[str, float], width: float = 1.0
) -> Scoreboard:
    """Four seeds that agree on four episodes, which differ alike for all labels."""
    hard = mean_interval(HARD[None])
    offsets = width * HARD / (hard.high - hard.value)
    values = {
        dataset: {k: np.repeat(v + offsets[None], 4, axis=0) for k, v in found.items()}
        for dataset, found in scores.items()
    }
    return Scoreboard(SCORE, values, data, FAMILIES)


def test_bold_are_those_that_are_not_clearly_worse() -> None:
    rng = np.random.default_rng(0)
    hard = 50 * rng.normal(size=(1, 40))
    means = {"bc": 0.0, "vdn": 9.0, "qmix": 10.0}
    values = {label: mean + hard + rng.normal(size=(4, 40)) * 8 for label, mean in means.items()}
    board = Scoreboard(SCORE, {"x": values}, {}, FAMILIES)
    assert board.estimates["x"]["bc"].high > board.estimates["x"]["qmix"].low  # they overlap
    assert set(board.leaders("x")) == {"vdn", "qmix"}
    gap = board.lead("x", "qmix", "bc")
    assert gap == difference_interval(values["qmix"], values["bc"])
    assert gap.low > 0.0


NUMBERS = st.integers(-100, 100).map(float)
SCORES = st.dictionaries(st.sampled_from(sorted(FAMILIES)), NUMBERS, min_size=1)


@given(st.dictionaries(st.sampled_from(["x", "y"]), SCORES, min_size=1), NUMBERS, st.floats(0, 20))
def test_the_best_of_any_numbers_is_bold(
    scores: dict[str, dict[str, float]], own: float, width: float
) -> None:
    board = make_board(scores, dict.fromkeys(scores, own), width)
    table = scoreboard_table(board)
    for dataset in board.estimates:
        best = board.ranking(dataset)[0]
        assert scores[dataset][best] == max(scores[dataset].values())
        assert best in board.leaders(dataset)
    assert table.count("**") == 2 * sum(len(board.leaders(dataset)) for dataset in scores)


def test_durations_and_tables_are_readable() -> None:
    assert [duration(s) for s in (42, 210, 7560)] == ["42 s", "3.5 min", "2.1 h"]
    rows: list[dict[str, object]] = [{"a": 1, "b": 0.1}, {"a": None, "c": "x", "b": float("nan")}]
    assert to_csv(rows) == "a,b,c\n1,0.1,\n,,x\n"


def test_a_row_is_optimal_if_no_other_is_as_good_in_both() -> None:
    success = {"bold": at(90.0), "careful": at(60.0), "poor": at(50.0), "idle": at(0.0)}
    clean = {"bold": at(20.0), "careful": at(55.0), "poor": at(40.0), "idle": at(0.0)}
    crashes = {"bold": at(3.0), "careful": at(0.5), "poor": at(1.0), "idle": at(0.0)}
    assert pareto_optimal(success, clean, more=True) == ["bold", "careful"]
    assert pareto_optimal(success, crashes, more=False) == ["bold", "careful", "idle"]


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
