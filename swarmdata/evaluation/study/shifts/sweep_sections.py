"""The sections of a page on a study's sweeps, from the tables beside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.drawing.style import line_looks
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.figures.line_plot import plot_lines
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.robustness.sweep_plots import (
    PANEL_HEIGHT,
    axis_label,
    degradation_panel,
)
from swarmdata.evaluation.robustness.sweep_tables import SWEEP_FILE, Degradation, read_csv
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.plan import Study
from swarmdata.specs.plain_names import without_version

SWEEPS_FOLDER = "sweeps"
"""Holds results in the study's folder of cells, and tables and figures beside its page."""

FIGURE = "robustness.png"

SOLVED = tuple(QUANTITIES[key].column for key in ("success", "clean_success"))


def read_sweeps(study: Study, folder: Path) -> dict[str, Degradation]:
    """Reads the sweeps of a study's plan that stand beside its page, by label."""
    files = {label: folder / SWEEPS_FOLDER / label / SWEEP_FILE for label in sorted(study.sweeps)}
    return {label: read_csv(file) for label, file in files.items() if file.exists()}


def sweep_sections(
    study: Study, sweeps: Mapping[str, Degradation], looks: Looks, out: Path
) -> list[tuple[str, str]]:
    """A figure of all sweeps, and what is left of each row at the worst value of each."""
    if not sweeps:
        return []
    plot_sweeps([*sweeps.values()], looks, out / FIGURE)
    whole = "Robustness", f"![success in worse conditions]({FIGURE})"
    return [whole, *(_section(study, *sweep) for sweep in sweeps.items())]


def _section(study: Study, label: str, found: Degradation) -> tuple[str, str]:
    plan = study.sweeps[label]
    models = {"observation": plan.observation, "communication": plan.communication}
    seen = ", ".join(f"{kind} `{model}`" for kind, model in models.items() if model)
    return f"Robustness: {found.part} {found.name}", (
        f"Data: {without_version(short_name(plan.dataset))}{f', {seen}' if seen else ''}; "
        f"{found.n_episodes:,} seeds at each value; changes are paired by training seed and "
        f"episode. [All values]({SWEEPS_FOLDER}/{label}/{SWEEP_FILE}).\n\n"
        f"{_table(label, found)}"
    )


def _table(label: str, found: Degradation) -> str:
    """A row for each row of the study: as trained, and at the worst value."""
    worst, change = found.lines[-1].points[-1].value, found.columns[-1]
    places = [found.column(column.key) for column in SOLVED]
    rows = []
    for line in found.lines:
        last = next(point for point in line.points if point.value == worst)
        solved = (
            format_estimate(point.estimates[place], column)
            for point in (line.trained, last)
            for place, column in zip(places, SOLVED, strict=True)
        )
        rows.append((f"`{line.label}`", *solved, format_difference(last.estimates[-1], change)))
    head = (
        label,
        *(f"{column.header}, as trained" for column in SOLVED),
        *(f"{column.header}, {found.name} {worst:g}" for column in SOLVED),
        change.label,
    )
    return markdown.table(head, rows)


def plot_sweeps(sweeps: Sequence[Degradation], looks: Looks, path: Path) -> None:
    """Draws a column for each sweep, success above clean success; worse values are on the right."""
    styles = {label: {**looks[label], **look} for label, look in line_looks(looks).items()}
    rows = []
    for column in SOLVED:
        row = [degradation_panel(each, column.key, styles)._replace(title="") for each in sweeps]
        rows.append([row[0]._replace(ylabel=column.header), *row[1:]])
    for k, each in enumerate(sweeps):
        label = axis_label(each).replace(" (", "\n(").replace(" of ", "\nof ", 1)
        rows[-1][k] = rows[-1][k]._replace(xlabel=label)
    plot_lines(rows, path, height=PANEL_HEIGHT, shares_x=True, shares_y="row", base=sweeps[0].base)
