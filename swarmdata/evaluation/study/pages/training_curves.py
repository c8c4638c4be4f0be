"""The sections on training: learning curves, and logged quantities such as Q-values."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.drawing.style import family_looks, line_looks
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.figures.line_plot import LinePanel, plot_lines
from swarmdata.evaluation.results.learning_curves import Curve, curve_line, last_gain
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_in_grid
from swarmdata.learn.training.run_files import CURVE, LOSSES

PANEL_HEIGHT = 1.45  # inches

MAX_ON_LINEAR_AXIS = 50.0  # larger values get a logarithmic axis, so that small ones stay visible

CURVES_CAPTION = (
    "Means over seeds, in bands from the lowest to the highest seed. Success at the end (%), and "
    "in brackets its gain over the last fifth of the"
)

Panels = dict[str, dict[str, Curve]]


def curve_section(found: Findings, out: Path) -> dict[str, str]:
    """Team success during training, and its gain over the last fifth."""
    panels = _panels(found, _offline_grid(found), CURVE, "success")
    if not panels:
        return {}
    drawn: Panels = {}
    for dataset, curves in panels.items():
        for label, curve in curves.items():
            drawn.setdefault(f"{dataset}\n{found.family(label)}", {})[label] = curve
    n_families = len({found.family(label) for curves in panels.values() for label in curves})
    plot_training_curves(
        drawn, found.looks, out / "curves.png", "team success (%)", factor=100.0,
        n_columns=n_families,
    )  # fmt: skip
    return {
        "Convergence of training": "![team success during training](curves.png)\n\n"
        f"{CURVES_CAPTION} updates:\n\n{_gain_table(panels)}\n"
    }


def online_curve_section(found: Findings, out: Path) -> dict[str, str]:
    """Team success on validation episodes during online training, and its gain at the end."""
    cells = [cell for cell in found.cells if cell.kind == "online"]
    panels = _panels(found, cells, CURVE, "success")
    if not panels:
        return {}
    drawn = {  # by row without its task, so that a color means the same on all tasks
        task: {label.removesuffix(f"-{task}"): curve for label, curve in curves.items()}
        for task, curves in panels.items()
    }
    looks = family_looks({name: name for curves in drawn.values() for name in curves})
    plot_training_curves(
        drawn, looks, out / "online-curves.png", "success (%)", factor=100.0, n_columns=2,
        xlabel="joint steps",
    )  # fmt: skip
    return {
        "Convergence of online training": "![success on validation episodes](online-curves.png)"
        f"\n\n{CURVES_CAPTION} steps:\n\n{_gain_table(panels)}\n"
    }


def plot_training_curves(
    panels: Panels,
    looks: Looks,
    path: Path,
    ylabel: str,
    *,
    factor: float = 1.0,
    yscale: str = "linear",
    n_columns: int = 3,
    xlabel: str = "gradient updates",
) -> None:
    """Draws values over training, by title and algorithm: means in bands of all seeds.

    `factor` is from values to the unit of the vertical axis, which all panels share.
    """
    styles = {name: {**looks[name], **look} for name, look in line_looks(looks).items()}
    drawn = [
        LinePanel(
            title, [curve_line(k, curve, styles[k], factor) for k, curve in curves.items()],
            yscale=yscale,
        )
        for title, curves in panels.items()
    ]  # fmt: skip
    rows = [drawn[k : k + n_columns] for k in range(0, len(drawn), n_columns)]
    plot_lines(rows, path, height=PANEL_HEIGHT, xlabel=xlabel, ylabel=ylabel, shares_y="all")


def _gain_table(panels: Panels) -> str:
    gains = {
        (label, dataset): f"{100 * c.values[:, -1].mean():.1f} ({100 * last_gain(c):+.1f})"
        for dataset, curves in panels.items()
        for label, c in curves.items()
    }
    return markdown.pivot("algorithm", panels, gains)


def _offline_grid(found: Findings) -> list[Cell]:
    return [
        cell for cell in found.cells if cell.kind == "offline" and is_in_grid(found.study, cell)
    ]


def loss_sections(found: Findings, out: Path) -> list[tuple[str, str]]:
    """Title and body of each figure of logged quantities that the study asks for."""
    parts = []
    for name, wanted in found.study.losses.items():
        data = [short_name(dataset) for dataset in wanted.datasets]
        cells = [c for c in _offline_grid(found) if c.data in data and c.label in wanted.algorithms]
        if panels := _panels(found, cells, LOSSES, wanted.column):
            file = f"losses-{name}.png"
            curves = [curve for each in panels.values() for curve in each.values()]
            is_log = any(abs(curve.values).max() > MAX_ON_LINEAR_AXIS for curve in curves)
            scale = "symlog" if is_log else "linear"  # linear from -2 to 2
            plot_training_curves(panels, found.looks, out / file, wanted.label, yscale=scale)
            title = wanted.label[:1].upper() + wanted.label[1:]
            parts.append((title, f"![{wanted.label}]({file})\n\n{_ends_table(panels)}"))
    return parts


def _panels(found: Findings, cells: Sequence[Cell], file: str, column: str) -> Panels:
    """The curves of cells by their data, without those that were not measured."""
    panels: Panels = {}
    for cell in cells:
        if (curve := found.training_curve(cell, file, column)) is not None:
            panels.setdefault(cell.data, {})[cell.label] = curve
    return panels


def _ends_table(panels: Panels) -> str:
    head = ("dataset", "algorithm", "first", "last", "lowest seed", "highest seed")
    rows = []
    for dataset, curves in panels.items():
        for label, curve in curves.items():
            last = curve.values[:, -1]
            ends = (curve.values[:, 0].mean(), last.mean(), last.min(), last.max())
            rows.append((dataset, f"`{label}`", *(f"{each:.3g}" for each in ends)))
    return markdown.table(head, rows)
