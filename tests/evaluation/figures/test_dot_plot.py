"""Dot plots name what they show, share axes, and nothing is cut off."""

import math
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing import style
from swarmdata.drawing.style import PAGE_WIDTH, family_looks
from swarmdata.evaluation.figures import dot_plot
from swarmdata.evaluation.figures.dot_plot import (
    HOLLOW_LOOK,
    Panel,
    PanelLine,
    plot_by_dataset,
    plot_dots,
)
from swarmdata.rollouts.score_statistics import Estimate
from tests.evaluation.figures.conftest import Shown
from tests.support.drawn import label_faults

FAMILIES = {f"algorithm_{k}-with-a-long-name": f"family {k % 4}" for k in range(10)}
LOOKS = family_looks(FAMILIES)
DATASETS = [f"coop_nav-a-rather-long-dataset-{k}-mini" for k in range(4)]
SCORES = {
    dataset: {
        label: Estimate(10.0 * place - k, 10.0 * place - k - 5, 10.0 * place - k + 5)
        for k, label in enumerate(FAMILIES)
    }
    for place, dataset in enumerate(DATASETS)
}


def test_panels_share_their_axis_the_best_row_is_on_top_and_nothing_is_cut_off(
    shown: Shown,
) -> None:
    def draw(path: Path) -> None:
        plot_by_dataset(SCORES, {DATASETS[0]: 3.0}, LOOKS, path, label="score", families=FAMILIES)

    drawing = shown(dot_plot, draw)
    panels = [axes for axes in drawing.axes if axes.get_visible()]
    assert len(panels) == len(DATASETS)
    assert len({axes.get_xlim() for axes in panels}) == 1
    assert [text.get_text() for text in panels[0].get_yticklabels()] == list(FAMILIES)
    assert panels[0].get_ylim()[0] > panels[0].get_ylim()[1], "the first row is on top"
    names = {text.get_text() for text in drawing.legends[0].get_texts()}
    assert names == {*FAMILIES.values(), "mean of the data"}
    assert drawing.get_figwidth() <= PAGE_WIDTH
    assert label_faults(drawing) == []


def test_fixed_ends_hold_and_others_follow_the_intervals(shown: Shown) -> None:
    wide = {"a": Estimate(50.0, -40.0, 140.0), "b": Estimate(2.0, math.nan, math.nan)}
    panels = [
        Panel(wide, "success (%)", limits=(0.0, 100.0)),
        Panel(wide, "collisions", limits=(0.0, None), hollow=["a"]),
    ]
    lines, looks = [PanelLine(["a", "b"], panels)], family_looks({"a": "a", "b": "b"})
    legend = {"x": HOLLOW_LOOK}
    drawing = shown(dot_plot, lambda path: plot_dots(lines, looks, path, legend=legend))
    first, second = (axes.get_xlim() for axes in drawing.axes)
    assert first == pytest.approx((-4.0, 104.0))
    assert second == pytest.approx((-5.6, 145.6))
    faces = [line.get_markerfacecolor() for line in drawing.axes[1].get_lines()]
    assert faces.count("white") >= 2, "a is not optimal, b has no interval"


@pytest.mark.slow
def test_a_second_run_writes_the_same_bytes_png_and_pdf(tmp_path: Path) -> None:
    scores = {"data": {"a": Estimate(1.0, 0.0, 2.0)}}
    for name in "ab":
        plot_by_dataset(scores, {}, {}, tmp_path / f"{name}.png", label="score")
    for suffix in (".png", ".pdf"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert style.files_of(tmp_path / "a.png") == (tmp_path / "a.png", tmp_path / "a.pdf")
    assert style.files_of(tmp_path / "a.png", "screen") == (tmp_path / "a.png",)
