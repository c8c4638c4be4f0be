"""The figure that most answers have: differences with intervals, a row each, beside 0."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.evaluation.figures.dot_plot import HOLLOW_LOOK, Panel, PanelLine, plot_dots
from swarmdata.evaluation.study.pages.row_differences import verdict_of
from swarmdata.rollouts.score_statistics import Estimate


def plot_differences_from_zero(
    groups: Mapping[str, Mapping[str, Sequence[Estimate]]], labels: Sequence[str], path: Path
) -> None:
    """Draws differences: a line of panels for each group, a panel for each quantity.

    Rows are sorted by the first quantity, the highest on top. Markers of differences that may be 0
    are not filled.

    Args:
        groups: title -> row -> difference of each quantity, in shown units; NaN is left out.
        labels: of the axes, one for each quantity.
        path: where to save.
    """
    lines = []
    for title, found in groups.items():
        rows = sorted(found, key=lambda row: (-found[row][0].value, row))
        panels = []
        for k, label in enumerate(labels):
            known = {row: found[row][k] for row in rows if not math.isnan(found[row][k].value)}
            unclear = [row for row, each in known.items() if verdict_of(each) == "no clear change"]
            panels.append(Panel(known, label, "" if k else title, scale=label, hollow=unclear))
        lines.append(PanelLine(rows, panels))
    plot_dots(lines, {}, path, legend={"no clear change": HOLLOW_LOOK}, zero=True)
