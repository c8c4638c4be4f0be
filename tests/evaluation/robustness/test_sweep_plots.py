"""The figure of a sweep: every team in every panel, and what it was trained with."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="figures need matplotlib")

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.robustness.sweep_plots import PANEL_COLUMNS, plot_degradation
from swarmdata.evaluation.robustness.sweep_tables import Degradation, Point, TeamLine
from swarmdata.rollouts.score_statistics import Estimate

RATES = ("success", "clean_success")


def line(label: str, n_runs: int, trained: float | None, *values: float) -> TeamLine:
    """A team whose metrics fall along the axis; its time to goal is not defined."""
    points = [(trained, True), *((value, False) for value in values)]
    size = len(PANEL_COLUMNS) + 1
    return TeamLine(
        label,
        n_runs,
        tuple(
            Point(at, is_trained, (Estimate(0.9 - 0.1 * k, 0.8 - 0.1 * k, 1 - 0.1 * k),) * size)
            for k, (at, is_trained) in enumerate(points)
        ),
    )


def draw(out: Path, *lines: TeamLine, first: str = "score", name: str = "drop") -> str:
    columns = tuple(
        Column(key, key.replace("_", " "), "", 1, 100.0 if key in RATES else 1.0, key in RATES)
        for key in (first, *PANEL_COLUMNS)
    )
    found = Degradation("communication", name, columns, lines, 9, falls=False)
    plot_degradation(found, out)
    return out.read_text(encoding="utf-8")


def said(svg: str) -> list[str]:
    """Texts of an SVG, which are drawn as paths under a comment."""
    return re.findall(r"<!-- (.*?) -->", svg)


@pytest.mark.slow
def test_panels_and_legend(tmp_path: Path) -> None:
    texts = said(draw(tmp_path / "x.svg", line("bc", 3, 0.3, 0.5, 0.8), line("one", 1, 0.0, 0.8)))
    for text in ("score", "success", "robot collisions", "bc (3 seeds)", "one", "as trained"):
        assert text in texts
    assert texts.count("share of messages lost") == 3
    assert "as trained, not on the axis" not in texts


@pytest.mark.slow
def test_a_training_without_a_place_on_the_axis_has_a_line_of_its_own(tmp_path: Path) -> None:
    texts = said(draw(tmp_path / "x.svg", line("bc", 3, None, 2, 1), first="return", name="other"))
    assert "return" in texts
    assert "communication other" in texts
    assert "as trained, not on the axis" in texts
    assert "as trained" not in texts


@pytest.mark.slow
def test_no_skill_is_seen_however_low_the_scores_are(tmp_path: Path) -> None:
    team = line("bc", 2, 0.0, 0.5)
    low = tuple(
        replace(point, estimates=(Estimate(-40.0, -44.0, -36.0), *point.estimates[1:]))
        for point in team.points
    )
    texts = said(draw(tmp_path / "x.svg", replace(team, points=low)))
    assert "\N{MINUS SIGN}40" in texts
    assert texts.count("0") == 1 + len(RATES) + 3  # the score, rates, and each column's axis


def test_more_teams_than_looks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="Sweep fewer"):
        draw(tmp_path / "x.svg", *(line(str(k), 1, 0.0, 1.0) for k in range(19)))
    assert not (tmp_path / "x.svg").exists()
