"""The figure of online learning: success and return over training, by task and algorithm."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import COLORS, draw_grid, figure, thousands
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.curve_plots import Curve, read_curve
from swarmdata.types import Double

METRICS = (("success", "team success (%)", 100.0), ("return", "team return", 1.0))
"""Rows of the figure: column, label with unit, factor to that unit."""

N_RESAMPLES, LEVEL, SEED = 2_000, 0.95, 0
"""Of the bootstrap."""

_LABEL_GAP = 0.075  # of the axes' height, between two labels at the ends of lines

_NAME = {"algorithm": "(?P<algorithm>[^/-]+)", "task": "(?P<task>[^/]+)", "*": "[^/]*"}

Grouped = Mapping[str, Mapping[str, Sequence[Path]]]
"""Task -> algorithm -> files of its runs."""


def group_files(files: Sequence[Path], pattern: str) -> dict[str, dict[str, list[Path]]]:
    """Sorts files of runs by the task and the algorithm that their names tell.

    Args:
        files: such as `runs/mappo/coop_nav/curve.csv`.
        pattern: what the end of a path without its suffix looks like, with `algorithm` and `task`
            once each and `*` for anything: here `algorithm/task/*`. Tasks may have hyphens in
            their names, algorithms not.

    Returns:
        task -> algorithm -> files, each in the order in which it first occurs.

    Raises:
        SchemaError: a pattern without the two words, or a file that does not fit.
    """
    parts = re.split(r"(algorithm|task|\*)", pattern)
    if sorted(part for part in parts if part in ("algorithm", "task")) != ["algorithm", "task"]:
        raise SchemaError(
            f"pattern {pattern!r} does not have 'algorithm' and 'task' once each, expected for "
            "example 'algorithm/task' for mappo/coop_nav.csv."
        )
    expression = "".join(_NAME.get(part, re.escape(part)) for part in parts)
    found: dict[str, dict[str, list[Path]]] = {}
    for file in files:
        match = re.search(f"(?:^|/){expression}$", file.with_suffix("").as_posix())
        if match is None:
            raise SchemaError(
                f"{file} does not end as {pattern!r} says, so its algorithm and task are unknown. "
                "Name files accordingly, or give another --by."
            )
        task, algorithm = match["task"], match["algorithm"]
        found.setdefault(task, {}).setdefault(algorithm, []).append(file)
    return found


def interval_of(curve: Curve) -> tuple[Double, Double]:
    """Ends of the 95 % interval of the mean over runs at each point, [P] each.

    Percentile bootstrap over whole runs (Agarwal et al., "Deep Reinforcement Learning at the Edge
    of the Statistical Precipice", NeurIPS 2021, section 4.1): a resample has as many runs as there
    are, the same at every point. One run has an interval without width, which says nothing.
    """
    n_runs = len(curve.values)
    generator = np.random.Generator(np.random.PCG64(SEED))
    counts = generator.multinomial(n_runs, np.full(n_runs, 1.0 / n_runs), size=N_RESAMPLES)
    means = (counts / n_runs) @ curve.values
    tail = (1.0 - LEVEL) / 2.0
    low, high = np.quantile(means, [tail, 1.0 - tail], axis=0)
    return low, high


def plot_learning(curves: Grouped, out: Path, *, log: bool = False) -> None:
    """Draws success above and return below, a column for each task, a line for each algorithm.

    A line is the mean over runs, its band the 95 % bootstrap interval. Lines end in their labels,
    with the number of runs.

    Args:
        curves: files with the columns `frames`, `success`, `return` and, for several runs in one
            file, `seed`.
        out: where to save; the suffix is the format.
        log: whether joint steps are logarithmic.

    Raises:
        SchemaError: nothing to draw, malformed files, runs of one line measured at different
            points, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    if not curves or not all(curves.values()):
        raise SchemaError("there are no curves to draw, expected at least one file for each task.")
    algorithms = list(dict.fromkeys(name for lines in curves.values() for name in lines))
    colors = {name: COLORS[k % len(COLORS)] for k, name in enumerate(algorithms)}
    read = {  # before drawing, so that a malformed file leaves no figure
        (task, column): {
            name: read_curve(files, column, progress="frames") for name, files in lines.items()
        }
        for task, lines in curves.items()
        for column, _, _ in METRICS
    }
    with figure(out, width=0.9 + 3.9 * len(curves), height=5.6) as drawing:
        grid = drawing.subplots(len(METRICS), len(curves), squeeze=False, sharex="col")
        for axes, task in zip(grid[0], curves, strict=True):
            axes.set_title(task, fontweight="bold", loc="left")
        for row, (column, ylabel, factor) in zip(grid, METRICS, strict=True):
            for axes, task in zip(row, curves, strict=True):
                _draw_panel(axes, read[task, column], colors, factor, is_share=factor != 1.0)
                if log:
                    axes.set_xscale("log")
                    axes.minorticks_off()
                axes.xaxis.set_major_formatter(thousands)
            row[0].set_ylabel(ylabel)
        for axes in grid[-1]:
            axes.set_xlabel("joint steps of training")
        for axes in grid.ravel():
            _label_ends(axes)


def _draw_panel(
    axes: Any,
    lines: Mapping[str, Curve],
    colors: Mapping[str, str],
    factor: float,
    *,
    is_share: bool,
) -> None:
    for name, curve in lines.items():
        low, high = interval_of(curve)
        if len(curve.values) > 1:
            axes.fill_between(
                curve.progress, factor * low, factor * high, color=colors[name], alpha=0.18, lw=0
            )
        n_runs = len(curve.values)
        label = f"{name} ({n_runs} {'run' if n_runs == 1 else 'runs'})"
        mean = factor * curve.values.mean(axis=0)
        axes.plot(curve.progress, mean, color=colors[name], lw=1.8, label=label)
    axes.margins(x=0)
    if is_share:
        axes.set_ylim(-2.0, 102.0)
    draw_grid(axes, "y")


def _label_ends(axes: Any) -> None:
    """Writes each line's label at its end, clear of the others."""
    low, high = axes.get_ylim()
    lines = axes.get_lines()
    wanted = np.array([(line.get_ydata()[-1] - low) / (high - low) for line in lines])
    for line, place in zip(lines, spread_labels(wanted, _LABEL_GAP), strict=True):
        axes.annotate(
            line.get_label(),
            (1.0, place),
            xycoords="axes fraction",
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=line.get_color(),
            annotation_clip=False,
        )


def spread_labels(wanted: Double, gap: float) -> Double:
    """Places for labels at least `gap` apart, as near to those wanted as can be, in their order.

    Least squares: without their gaps the places must not decrease, which pooling adjacent violators
    solves (Barlow, Bartholomew, Bremner and Brunk, "Statistical Inference under Order
    Restrictions", 1972, section 1.2). They stay within [0, 1] if they fit.
    """
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []  # mean and number of labels that stand together
    for value in (wanted[order] - steps).tolist():
        mean, n = value, 1
        while blocks and blocks[-1][0] > mean:
            before, m = blocks.pop()
            mean, n = (before * m + mean * n) / (m + n), m + n
        blocks.append((mean, n))
    level = np.repeat([mean for mean, _ in blocks], [n for _, n in blocks])
    places = np.empty(len(wanted))
    places[order] = np.clip(level, 0.0, max(0.0, 1.0 - steps[-1])) + steps
    return places
