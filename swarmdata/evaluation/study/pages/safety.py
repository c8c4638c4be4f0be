"""The sections on safety: success, success without a collision, and collisions of every row."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

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
from swarmdata.evaluation.study.pages.collect_results import Findings, facts_by_dataset
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.evaluation.study.pages.study_matrices import plot_board
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.rollouts.score_intervals import AT_LEAST_ZERO
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

MAX_ALGORITHMS_IN_MATRIX = 24  # algorithms of which all pairs fit into a figure

COLLISIONS = Column("collisions", "collisions per episode", "", 2, bounds=AT_LEAST_ZERO)
"""New contacts of a robot with others and with obstacles, counted from events."""

Pairs = Mapping[str, tuple[Estimate, Estimate]]  # label -> (horizontal, vertical), as shown


class Fronts(NamedTuple):
    """Success of every row on a dataset, against clean success and against collisions."""

    clean: Pairs  # label -> clean success and success, in percent
    collisions: Pairs  # label -> collisions per episode, and success in percent

    @property
    def cleanest(self) -> tuple[str, ...]:
        """Pareto-optimal labels in success and clean success."""
        return _front(self.clean, sign=-1.0)

    @property
    def safest(self) -> tuple[str, ...]:
        """Pareto-optimal labels in success and collisions."""
        return _front(self.collisions, sign=1.0)


def _front(points: Pairs, sign: float) -> tuple[str, ...]:
    values = [y.value for _, y in points.values()]
    found = pareto_front(values, [sign * x.value for x, _ in points.values()])
    return tuple(label for label, is_best in zip(points, found.tolist(), strict=True) if is_best)


def _collision_board(found: Findings) -> Scoreboard:
    """Collisions with robots and obstacles together; fewer are better, so its ranks mean little."""
    values = {
        case.name: {k: collisions(case, k) for k in found.families if k in case.runs}
        for case in found.results.cases
    }
    known = facts_by_dataset(found.facts)
    data = {name: each.robot_collisions + each.obstacle_collisions for name, each in known.items()}
    return Scoreboard(COLLISIONS, values, data, found.families)


def _in_both(x: Scoreboard, y: Scoreboard, dataset: str) -> Pairs:
    first, second = x.in_shown_units(dataset), y.in_shown_units(dataset)
    return {label: (first[label], second[label]) for label in first if label in second}


def plot_safety(
    found: Findings, boards: Sequence[Scoreboard], fronts: Mapping[str, Fronts], path: Path
) -> None:
    """Draws success, clean success and collisions: a line for each dataset, a row for each label.

    Rows are sorted by success. Markers of clean success and of collisions are filled where the row
    is Pareto-optimal in this and success.
    """
    tasks = {without_version(case.name): case.spec.task for case in found.results.cases}
    lines = [
        _safety_line(each, dataset, tasks[dataset], [b.shown_data.get(dataset) for b in boards])
        for dataset, each in fronts.items()
    ]
    shown = {label for each in fronts.values() for label in each.clean}
    families = {label: family for label, family in found.families.items() if label in shown}
    legend = {
        **family_legend(families, found.looks),
        "not Pareto-optimal in this and success": HOLLOW_LOOK,
    }
    plot_dots(lines, found.looks, path, legend=legend)


def _safety_line(
    fronts: Fronts, dataset: str, task: str, means: Sequence[float | None]
) -> PanelLine:
    """The panels of a dataset with the means of its data; collisions are compared in a task."""
    success = {label: y for label, (_, y) in fronts.clean.items()}
    clean = {label: x for label, (x, _) in fronts.clean.items()}
    crashes = {label: x for label, (x, _) in fronts.collisions.items()}
    rows = sorted(success, key=lambda label: (-success[label].value, label))
    unclean, unsafe = {*rows} - {*fronts.cleanest}, {*rows} - {*fronts.safest}
    rate, contacts = ("rate", (0.0, 100.0)), (f"collisions in {task}", (0.0, None))
    panels = (
        Panel(success, "success (%)", dataset, means[0], *rate),
        Panel(clean, "clean success (%)", "", means[1], *rate, unclean),
        Panel(crashes, COLLISIONS.label, "", means[2], *contacts, unsafe),
    )
    return PanelLine(rows, panels)


def front_table(fronts: Mapping[str, Fronts]) -> str:
    """The Pareto-optimal rows of each dataset."""
    head = ("dataset", "Pareto-optimal in success and clean success", "in success and collisions")
    rows = [
        (dataset, *(", ".join(f"`{label}`" for label in k) for k in (each.cleanest, each.safest)))
        for dataset, each in fronts.items()
    ]
    return markdown.table(head, rows)


def safety_sections(found: Findings, out: Path) -> dict[str, str]:
    """The sections by title."""
    success, clean = found.board("success"), found.board("clean_success")
    crashes = _collision_board(found)
    fronts = {
        without_version(dataset): Fronts(
            _in_both(clean, success, dataset), _in_both(crashes, success, dataset)
        )
        for dataset in success.estimates
    }
    if fits_on_a_screen(max(len(each.clean) for each in fronts.values()), len(fronts)):
        plot_safety(found, (success, clean, crashes), fronts, out / "safety.png")
    else:
        solved = {
            dataset: {label: each.value for label, each in success.in_shown_units(dataset).items()}
            for dataset in clean.estimates
        }
        scale = "clean success minus success, percentage points"
        plot_board(clean, out / "safety.png", solved, scale)
    body = (
        f"Episodes solved (%):\n\n{scoreboard_table(success)}\n"
        f"Episodes solved without a collision (%):\n\n{scoreboard_table(clean)}\n"
        "Collisions per episode, which are new contacts with robots and obstacles (fewer are "
        f"better):\n\n{scoreboard_table(crashes, is_ranked=False)}\n"
        f"{front_table(fronts)}\n"
        "![success, clean success and collisions](safety.png)\n"
    )
    plot_pareto(found.results.cases, out / "collisions.png", found.looks)
    returns = (
        "A line joins the Pareto-optimal rows of a dataset, which are filled; the dashed line is "
        "the mean return of the data.\n\n![team return against collisions](collisions.png)\n"
    )
    return {"Success and collisions": body, "Return and collisions": returns}
