"""The matrix has each pair once, the better one as the row."""

from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures import difference_matrix
from swarmdata.evaluation.figures.difference_matrix import plot_difference_matrix
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.drawn import shown_figure


def test_each_pair_is_shown_once_and_clear_ones_are_bold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = ["best", "good", "poor"]
    gaps = {("best", "good"): 3.0, ("best", "poor"): 20.0, ("good", "poor"): 17.0}
    pairs = {
        pair: Estimate(sign * gap, sign * gap - 5.0, sign * gap + 5.0)
        for (one, other), gap in gaps.items()
        for pair, sign in (((one, other), 1.0), ((other, one), -1.0))
    }
    drawing = shown_figure(
        monkeypatch,
        difference_matrix,
        lambda: plot_difference_matrix(labels, pairs, tmp_path / "a.png"),
    )
    texts = {text.get_text(): text.get_fontweight() for text in drawing.axes[0].texts}
    assert texts == {"+3": "normal", "+20": "bold", "+17": "bold"}
    with pytest.raises(SchemaError, match="at least two"):
        plot_difference_matrix(["one"], {}, tmp_path / "b.png")
