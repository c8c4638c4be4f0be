"""Line panels: ticks at the numbers of few points, and conditions that get worse to the right."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing.style import family_looks
from swarmdata.evaluation.figures import line_panels
from swarmdata.evaluation.figures.line_panels import LinePanel, plot_line_panels
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.drawn import shown_figure


def drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: list[float], *, falls: bool = False
) -> Any:
    """The axes of one panel with two lines over the numbers."""
    line = {value: Estimate(value, value - 1, value + 1) for value in numbers}
    panel = LinePanel("range", "range (m)", {"bc": line, "iql": line}, falls=falls)
    looks = family_looks({"bc": "cloning", "iql": "in-sample"})
    drawing = shown_figure(
        monkeypatch,
        line_panels,
        lambda: plot_line_panels([panel], looks, tmp_path / "a.png", ylabel="success (%)"),
    )
    return drawing.axes[0]


def tick_labels(axes: Any) -> list[str]:
    return [label.get_text() for label in axes.get_xticklabels()]


def test_few_numbers_are_the_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    axes = drawn(tmp_path, monkeypatch, [0.0, 0.7, 2.0])
    assert tick_labels(axes) == ["0", "0.7", "2"]


def test_many_numbers_have_round_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    axes = drawn(tmp_path, monkeypatch, [0.13 * k for k in range(20)])
    assert len(tick_labels(axes)) < 20
    assert "0.13" not in tick_labels(axes)


@pytest.mark.parametrize("falls", [True, False])
def test_what_falls_falls_to_the_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, falls: bool
) -> None:
    left, right = drawn(tmp_path, monkeypatch, [1.0, 2.0, 4.0], falls=falls).get_xlim()
    assert (left > right) == falls


def test_lines_have_their_estimates_and_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    axes = drawn(tmp_path, monkeypatch, [4.0, 1.0])
    assert [line.get_label() for line in axes.get_lines()] == ["bc", "iql"]
    assert axes.get_lines()[0].get_xydata().tolist() == [[1.0, 1.0], [4.0, 4.0]]
    assert {text.get_text() for text in axes.texts} == {"bc", "iql"}
