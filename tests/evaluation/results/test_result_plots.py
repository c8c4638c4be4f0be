"""Figures hold what was measured, in every format, and labels look alike in all of them."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from swarmdata.drawing.style import family_looks
from swarmdata.evaluation.figures import matrix_plot
from swarmdata.evaluation.results import result_plots
from swarmdata.evaluation.results.aggregates import comparable_scores
from swarmdata.evaluation.results.result_plots import (
    far_from_trained,
    looks_of,
    plot_differences,
    plot_estimates,
    plot_pareto,
    plot_result_scores,
    plot_score_profiles,
    result_looks,
)
from swarmdata.evaluation.results.result_set import Case, group_results
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.drawn import shown_figure
from tests.support.measured import MEANS, grid, result

pytest.importorskip("matplotlib", reason="figures need the plots extra")

RESULTS = group_results([*grid(MEANS), result("idle", None, mean=-12.0)])


def test_looks_differ_and_are_by_name() -> None:
    names = {f"label_{k:02d}": f"algorithm_{k // 2}" for k in range(20)}
    looks = looks_of(names, ["idle", "label_03", "random"])
    assert len({tuple(look.values()) for look in looks.values()}) == 22
    assert looks["idle"]["color"] == looks["random"]["color"]
    assert looks["label_00"]["color"] == looks["label_01"]["color"], "of one algorithm"
    assert looks_of(dict(reversed(names.items()))) == looks_of(names)


def test_scores_name_datasets_labels_and_the_data(tmp_path: Path) -> None:
    plot_result_scores(RESULTS, tmp_path / "scores.svg")
    text = (tmp_path / "scores.svg").read_text()
    for name in ("bc", "omar", "mean of the data", "coop_nav-medium", "coop_nav-expert"):
        assert f"<!-- {name} -->" in text


def test_profiles_and_differences_name_every_label(tmp_path: Path) -> None:
    tables = comparable_scores(RESULTS).tables
    plot_score_profiles(tables, result_looks(RESULTS), tmp_path / "a.svg")
    plot_differences(tables, tmp_path / "b.svg")
    for name in ("a.svg", "b.svg"):
        assert "<!-- omar -->" in (tmp_path / name).read_text()
    gap = float((tables["omar"] - tables["bc"]).mean())
    assert f"<!-- {gap:.0f} -->" in (tmp_path / "b.svg").read_text()


def test_no_two_profiles_look_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = family_looks({f"maddpg_bc-variant-{k}": f"family {k % 6}" for k in range(12)})
    tables = {label: np.full((2, 1, 3), 50.0) for label in looks}
    drawing = shown_figure(
        monkeypatch, result_plots, lambda: plot_score_profiles(tables, looks, tmp_path / "a.png")
    )
    lines = drawing.axes[0].get_lines()
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 12
    box = drawing.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= drawing.bbox.x1


def test_each_pair_is_shown_once_and_clear_ones_are_bold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = {"poor": -20.0, "good": -3.0, "best": 0.0}
    tables = {label: np.full((8, 1, 3), mean) for label, mean in labels.items()}
    tables["good"] += 5.0 * np.resize([1.0, -1.0], (8, 1, 1))  # its runs differ
    drawing = shown_figure(
        monkeypatch, matrix_plot, lambda: plot_differences(tables, tmp_path / "a.png")
    )
    texts = {text.get_text(): text.get_fontweight() for text in drawing.axes[0].texts}
    assert [texts[number] for number in ("3", "20", "17")] == ["normal", "bold", "bold"]


@pytest.mark.slow
def test_pareto_names_what_is_out_of_view(tmp_path: Path) -> None:
    cases, looks = map(RESULTS.with_baselines, RESULTS.cases), result_looks(RESULTS)
    plot_pareto([*cases], tmp_path / "pareto.svg", looks)
    text = (tmp_path / "pareto.svg").read_text()
    assert text.count("<!-- not in view") == 2
    assert "idle (" in text
    plot_pareto(RESULTS.baselines, tmp_path / "alone.svg", looks)
    assert "not in view" not in (tmp_path / "alone.svg").read_text()


@pytest.mark.parametrize(("worst", "far"), [(-60.0, ["worst"]), (-8.0, [])])
def test_a_row_far_below_the_others_is_out_of_view(worst: float, far: list[str]) -> None:
    returns = {"worst": worst, **{f"row_{k}": float(-k) for k in range(6)}}
    case = SimpleNamespace(trained=[*returns], data=SimpleNamespace(mean_return=-3.0))
    assert far_from_trained(cast("Case", case), returns) == far


def test_estimates_have_a_panel_for_each_quantity_with_the_same_rows(tmp_path: Path) -> None:
    rows = {"scripted": Estimate(90.0, 88.0, 92.0), "bc": Estimate(60.0, 50.0, 66.0)}
    panels = {"score": rows, "success (%)": rows}
    plot_estimates(panels, tmp_path / "table.svg", {})
    for label in (*panels, *rows):
        assert f"<!-- {label} -->" in (tmp_path / "table.svg").read_text()
