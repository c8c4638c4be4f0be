"""The sections on safety: success, success without a collision, and collisions of every row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.figures.dot_plot import (
    HOLLOW_LOOK,
    Panel,
    PanelLine,
    family_legend,
    fits_on_a_screen,
    plot_dots,
)
from swarmdata.evaluation.results.aggregates import collisions, pareto_front
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_plots import plot_pareto
from swarmdata.evaluation.results.result_set import Case
from swarmdata.evaluation.study.pages.collect_results import Findings, facts_by_dataset
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, plot_board
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.rollouts.score_intervals import AT_LEAST_ZERO
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

MAX_ALGORITHMS_IN_MATRIX = 24  # algorithms of which all pairs fit into a figure

COLLISIONS = Column("collisions", "collisions per episode", "", 2, bounds=AT_LEAST_ZERO)
"""New contacts of a robot with others and with obstacles, counted from events."""

Fronts = Mapping[str, tuple[Sequence[str], Sequence[str]]]
"""Dataset -> Pareto-optimal labels in success and clean success, and in success and collisions."""


def pareto_optimal(
    success: Mapping[str, Estimate], other: Mapping[str, Estimate], *, more: bool
) -> list[str]:
    """Labels that no other exceeds in success and a quantity of which more, or less, is better."""
    labels = [label for label in other if label in success]
    costs = [-other[label].value if more else other[label].value for label in labels]
    found = pareto_front([success[label].value for label in labels], costs)
    return [label for label, is_best in zip(labels, found.tolist(), strict=True) if is_best]


def _collision_board(found: Findings) -> Scoreboard:
    """Collisions with robots and obstacles together; fewer are better, so its ranks mean little."""
    values = {
        case.name: {k: collisions(case, k) for k in found.families if k in case.runs}
        for case in found.results.cases
    }
    known = facts_by_dataset(found.facts)
    data = {name: each.robot_collisions + each.obstacle_collisions for name, each in known.items()}
    return Scoreboard(COLLISIONS, values, data, found.families)


def plot_safety(found: Findings, boards: Sequence[Scoreboard], fronts: Fronts, path: Path) -> None:
    """Draws success, clean success and collisions: a line for each dataset, a row for each label.

    Rows are sorted by success. Markers of clean success and of collisions are filled where the row
    is Pareto-optimal in this and success. Collisions are compared in a task.
    """
    tasks, lines, rate = {c.name: c.spec.task for c in found.results.cases}, [], (0.0, 100.0)
    for name, optimal in fronts.items():
        dataset = without_version(name)
        success, clean, crashes = (board.in_shown_units(name) for board in boards)
        means = [board.shown_data.get(dataset) for board in boards]
        rows = sorted(success, key=lambda label: (-success[label].value, label))
        unclean, unsafe = ({*rows} - {*each} for each in optimal)
        scale = f"collisions in {tasks[name]}"
        panels = (
            Panel(success, "success (%)", dataset, means[0], "rate", rate),
            Panel(clean, "clean success (%)", "", means[1], "rate", rate, unclean),
            Panel(crashes, COLLISIONS.label, "", means[2], scale, (0.0, None), unsafe),
        )
        lines.append(PanelLine(rows, panels))
    shown = {label for line in lines for label in line.rows}
    families = {label: family for label, family in found.families.items() if label in shown}
    legend = {
        **family_legend(families, found.looks),
        "not Pareto-optimal in this and success": HOLLOW_LOOK,
    }
    plot_dots(lines, found.looks, path, legend=legend)


def safety_sections(found: Findings, out: Path) -> dict[str, str]:
    """The sections by title."""
    success, clean = found.board("success"), found.board("clean_success")
    crashes, fronts, rows = _collision_board(found), {}, []
    for name in success.estimates:
        solved, clear, hit = (each.in_shown_units(name) for each in (success, clean, crashes))
        fronts[name] = (
            pareto_optimal(solved, clear, more=True),
            pareto_optimal(solved, hit, more=False),
        )
        labels = (", ".join(f"`{label}`" for label in each) for each in fronts[name])
        rows.append((without_version(name), *labels))
    if fits_on_a_screen(max(map(len, success.estimates.values())), len(fronts)):
        plot_safety(found, (success, clean, crashes), fronts, out / "safety.png")
    else:
        base = {
            name: {label: each.value for label, each in success.in_shown_units(name).items()}
            for name in clean.estimates
        }
        scale = "clean success minus success, percentage points"
        plot_board(clean, out / "safety.png", base, scale)
    head = ("dataset", "Pareto-optimal in success and clean success", "in success and collisions")
    body = (
        f"Episodes solved (%):\n\n{scoreboard_table(success)}\n"
        f"Episodes solved without a collision (%):\n\n{scoreboard_table(clean)}\n"
        "Collisions per episode, which are new contacts with robots and obstacles (fewer are "
        f"better):\n\n{scoreboard_table(crashes, is_ranked=False)}\n"
        f"{markdown.table(head, rows)}\n"
        "![success, clean success and collisions](safety.png)\n"
    )
    plot_pareto(_drawn(found), out / "collisions.png", found.looks)
    where = "On the core of the study. " if found.study.core else ""
    returns = (
        f"{where}A line joins the Pareto-optimal rows of a dataset, which are filled; the dashed "
        "line is the mean return of the data.\n\n"
        "![team return against collisions](collisions.png)\n"
    )
    return {"Success and collisions": body, "Return and collisions": returns}


def _drawn(found: Findings) -> list[Case]:
    """The cases of the core, if there is one, without rows that are there to explain others."""
    results = found.core if found.study.core else found.results
    return [
        replace(
            case, runs={k: v for k, v in case.runs.items() if found.families.get(k) != "ablations"}
        )
        for case in results.cases
    ]
