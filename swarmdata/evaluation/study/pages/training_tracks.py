"""What training looked like: learning curves, and losses such as Q-values."""

from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.curve_plots import Curve
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import named
from swarmdata.evaluation.study.pages.collect_results import Findings, is_main
from swarmdata.evaluation.study.pages.study_figures import plot_tracks
from swarmdata.evaluation.study.plan import Losses

LARGE = 50.0
"""Of values, from which a figure needs a logarithmic axis to show the small ones beside them."""

Panels = dict[str, dict[str, Curve]]


def curve_section(found: Findings, out: Path) -> dict[str, str]:
    """Team success while training, and how much of it came in the last fifth."""
    panels: Panels = {}
    for cell in _main(found):
        curve = found.learning(cell, "success")
        if curve is not None:
            panels.setdefault(cell.data, {})[cell.label] = curve
    if not panels:
        return {}
    drawn = {
        f"{dataset}\n{family}": {k: v for k, v in curves.items() if found.family(k) == family}
        for dataset, curves in panels.items()
        for family in dict.fromkeys(map(found.family, curves))
    }
    n_families = len({found.family(label) for curves in panels.values() for label in curves})
    plot_tracks(
        drawn, out / "curves.png", ylabel="team success (%)", factor=100.0, n_columns=n_families
    )
    return {
        "Did training level off?": "![team success while training](curves.png)\n\n"
        "Means over seeds, in bands from the lowest to the highest. Success at the end (%), and "
        f"how much of it came in the last fifth of the updates:\n\n{_gains(panels)}\n"
    }


def _gains(panels: Panels) -> str:
    """A row for each algorithm, a column for each dataset."""
    labels = list(dict.fromkeys(label for curves in panels.values() for label in curves))
    rows = [
        [f"`{label}`", *(_gain(curves.get(label)) for curves in panels.values())]
        for label in labels
    ]
    return markdown.table(["algorithm", *panels], rows)


def _gain(curve: Curve | None) -> str:
    if curve is None:
        return "–"
    return f"{100 * curve.values[:, -1].mean():.1f} ({100 * _last_gain(curve):+.1f})"


def _main(found: Findings) -> list[Cell]:
    return [cell for cell in found.cells if cell.kind == "offline" and is_main(found.study, cell)]


def _last_gain(curve: Curve) -> float:
    """Mean over seeds at the end, minus that at four fifths of the updates."""
    before = int((curve.progress <= 0.8 * curve.progress[-1]).sum()) - 1
    means = curve.values.mean(0)
    return float(means[-1] - means[max(before, 0)])


def loss_sections(found: Findings, out: Path) -> dict[str, str]:
    """One part for each figure of losses that the study asks for."""
    parts = {}
    for name, wanted in found.study.losses.items():
        panels = _panels(found, wanted)
        if panels:
            file = f"losses-{name}.png"
            is_log = any(
                _largest(curve) > LARGE for each in panels.values() for curve in each.values()
            )
            plot_tracks(panels, out / file, ylabel=wanted.label, is_log=is_log)
            title = wanted.label[:1].upper() + wanted.label[1:]
            parts[title] = f"![{wanted.label}]({file})\n\n{_ends(panels)}"
    return parts


def _panels(found: Findings, wanted: Losses) -> Panels:
    panels: Panels = {}
    datasets = [named(dataset) for dataset in wanted.datasets]
    for cell in _main(found):
        if cell.data in datasets and cell.label in wanted.algorithms:
            curve = found.curve(cell, wanted.column)
            if curve is not None:
                panels.setdefault(cell.data, {})[cell.label] = curve
    return panels


def _largest(curve: Curve) -> float:
    return float(abs(curve.values).max())


def _ends(panels: Panels) -> str:
    """Where every line ends, in words."""
    return "".join(
        f"- `{label}` on {dataset}: from {curve.values[:, 0].mean():.3g} to "
        f"{curve.values[:, -1].mean():.3g} (mean over seeds; seeds end between "
        f"{curve.values[:, -1].min():.3g} and {curve.values[:, -1].max():.3g}).\n"
        for dataset, curves in panels.items()
        for label, curve in curves.items()
    )
