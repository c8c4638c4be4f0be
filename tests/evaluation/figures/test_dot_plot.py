"""Dot plots and fronts name what they show, share axes or not, and nothing is cut off."""

import math
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing import style
from swarmdata.drawing.style import PAGE_WIDTH, family_looks
from swarmdata.evaluation.figures import dot_plot, front_plot
from swarmdata.evaluation.figures.dot_plot import (
    HOLLOW_LOOK,
    Panel,
    PanelLine,
    plot_by_dataset,
    plot_dots,
)
from swarmdata.evaluation.figures.front_plot import FrontPanel, plot_fronts
from swarmdata.rollouts.score_statistics import Estimate
from tests.evaluation.figures.conftest import Shown
from tests.support.drawn import label_faults
from tests.support.measured import at

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


def panel(n: int, **changes: object) -> FrontPanel:
    """The first two of n points are on the front."""
    points = {f"row_{k}": (at(float(k), 1.0), at(9.0 - k, 1.0)) for k in range(n)}
    return FrontPanel(points, ["row_0", "row_1"], **changes)  # type: ignore[arg-type]


def test_panels_have_limits_of_their_own_and_far_points_are_listed(shown: Shown) -> None:
    panels = {
        "a": panel(3, line=4.0),
        "b": panel(5, far=["row_4"]),
        "a-name-that-is-longer-than-its-panel": panel(6),
    }
    looks = family_looks({f"row_{k}": f"family {k}" for k in range(6)})
    names = {"xlabel": "cost", "ylabel": "value"}
    drawing = shown(front_plot, lambda path: plot_fronts(panels, looks, path, **names))
    first, second, third = drawing.axes
    assert first.get_ylim()[0] < 4.0 < second.get_ylim()[0], "only the first has a line there"
    assert second.get_xlim()[1] < third.get_xlim()[1]
    assert third.get_title(loc="left").count("\n") == 1
    found = {text.get_text() for text in drawing.legends[0].get_texts()}
    assert found == {*looks, "not Pareto-optimal", "mean of the data"}
    assert second.get_xlabel() == "not in view: row_4 (4.0, 5.0)"
