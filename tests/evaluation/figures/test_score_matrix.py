"""A matrix of scores: what was not measured is empty, and nothing is minus zero."""

import math
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.evaluation.figures import score_matrix
from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from tests.support.drawn import shown_figure


def test_every_score_stands_in_its_row_and_column(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = {"easy": {"a": 99.6, "b": math.nan}, "hard": {"a": -0.4, "b": -20.0, "c": 7.0}}
    drawing = shown_figure(
        monkeypatch,
        score_matrix,
        lambda: plot_score_matrix(scores, tmp_path / "a.png", label="score", decimals=0),
    )
    (axes,) = drawing.axes
    rows, columns = (
        [text.get_text() for text in labels]
        for labels in (axes.get_yticklabels(), axes.get_xticklabels())
    )
    found = {
        (rows[round(y)], columns[round(x)]): text.get_text()
        for text in axes.texts
        for x, y in (text.get_position(),)
    }
    assert found == {
        ("easy", "a"): "100", ("easy", "b"): "", ("easy", "c"): "",
        ("hard", "a"): "0", ("hard", "b"): "-20", ("hard", "c"): "7",
    }  # fmt: skip
