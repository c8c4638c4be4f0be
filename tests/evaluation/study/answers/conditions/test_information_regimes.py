"""What views cost, and where a memory helps, in words, tables and figures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.evaluation.figures import dot_plot
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.answers.conditions import information_regimes
from swarmdata.evaluation.study.answers.conditions.information_regimes import (
    Views,
    best_scores,
    draw_views,
    memory_sentence,
    table_of,
    view_sentence,
)
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.types import Double
from tests.support.drawn import shown_figure


def scores(mean: float) -> Double:
    """Of 2 seeds on 4 episodes; differences between such scores are the same everywhere."""
    return np.tile(mean + np.arange(4.0) - 1.5, (2, 1))


@pytest.fixture
def views() -> Views:
    values = {
        "data": {"bc": scores(90), "bc-gru": scores(80), "iql": scores(70)},
        "data@heard": {"bc": scores(55), "bc-gru": scores(50), "iql": scores(75)},
        "data@lost": {"bc": scores(10), "bc-gru": scores(45)},
    }
    families = {"bc": "cloning", "bc-gru": "cloning", "iql": "in-sample"}
    board = Scoreboard(Column("score", "score", "", 1), values, {}, families)
    cases = {"recorded": "data", "heard": "data@heard", "lost": "data@lost"}
    return Views("nav", board, cases, {"heard": "recorded", "lost": "heard"})


def test_a_view_is_compared_with_the_one_that_the_plan_says(views: Views) -> None:
    text = view_sentence(views, "heard")
    assert text.startswith(
        "On nav, with `heard` instead of `recorded`, the score of 2 of 3 algorithms falls clearly "
        "and that of 1 rises; from −35.0 [−35.0, −35.0] (`bc`) to +5.0 [5.0, 5.0] (`iql`). The "
        "best is `iql` with 75.0 ["
    )
    text = view_sentence(views, "lost")
    assert "with `lost` instead of `heard`, the score of 2 of 2 algorithms falls" in text
    assert "and that of none rises" in text
    assert "from −45.0 [−45.0, −45.0] (`bc`) to −5.0 [−5.0, −5.0] (`bc-gru`)" in text


def test_the_best_scores_are_those_of_the_first_the_least_and_the_most_harmful_view(
    views: Views,
) -> None:
    text = best_scores(views)
    assert text.startswith("On nav, the best score is 90.0 [")
    assert "] with `recorded`, and from 75.0 [" in text
    assert "] with `heard` to 45.0 [" in text
    assert text.endswith("] with `lost` in 2 other views.")
    one = views._replace(cases={view: views.cases[view] for view in ("recorded", "lost")})
    assert "] with `recorded`, and 45.0 [" in best_scores(one)
    assert best_scores(one).endswith("] with `lost`.")


def test_a_memory_is_compared_in_each_view(views: Views) -> None:
    assert memory_sentence(views, "bc-gru", "bc") == (
        "On nav, `bc-gru` against `bc`: better in `lost` (+35.0 [35.0, 35.0]); worse in "
        "`recorded` (−10.0 [−10.0, −10.0]), `heard` (−5.0 [−5.0, −5.0])."
    )
    assert memory_sentence(views, "bc-gru", "vdn") == ""


def only(label: str, views: Views) -> Views:
    """The same views, measured for one algorithm."""
    values = {case: {label: found[label]} for case, found in views.board.values.items()}
    return views._replace(board=replace(views.board, values=values))


def test_several_algorithms_are_a_matrix_of_views(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(
        information_regimes, "plot_score_matrix", lambda values, *_, **__: drawn.append(values)
    )
    draw_views(views, tmp_path / "a.png")
    assert drawn[0]["lost"] == {"bc": 10.0, "bc-gru": 45.0}


def test_one_algorithm_has_a_row_with_an_interval_for_each_view(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="figures need the plots extra")
    one = only("bc", views)
    assert (views.measured, one.measured) == (["bc", "bc-gru", "iql"], ["bc"])
    drawing = shown_figure(monkeypatch, dot_plot, lambda: draw_views(one, tmp_path / "a.png"))
    (axes,) = drawing.axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["recorded", "heard", "lost"]
    assert axes.get_xlabel() == "score of bc"


def test_the_best_are_bold_where_several_are_compared(views: Views) -> None:
    assert "**90.0" in table_of(views)
    assert "**" not in table_of(only("bc", views))
