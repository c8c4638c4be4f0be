"""Performance profiles: the share of runs above each score."""

from collections.abc import Mapping
from pathlib import Path

from swarmdata.drawing.style import COLUMN_WIDTH, draw_grid, draw_legend, figure, line_looks
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.types import Double


def plot_profiles(
    profiles: Mapping[str, Double], thresholds: Double, looks: Looks, path: Path
) -> None:
    """Draws a line for each label; labels of one color differ in their dashes.

    Args:
        profiles: label -> shares of runs above each threshold, from 0 to 1, [P]; the legend has
            their order.
        thresholds: scores, [P].
        looks: color and marker of each label.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not profiles:
        raise SchemaError("there are no profiles to draw, expected at least one label.")
    drawn = line_looks({label: looks[label] for label in profiles})
    with figure(path, width=COLUMN_WIDTH, height=2.45) as drawing:
        axes = drawing.add_subplot()
        for label, share in profiles.items():
            axes.plot(thresholds, 100 * share, lw=1.4, ds="steps-mid", label=label, **drawn[label])
        axes.set(xlabel="score τ (0 no skill, 100 expert)", ylabel="runs with a score above τ (%)")
        axes.set_ylim(-2, 102)
        axes.margins(x=0)
        draw_grid(axes, width=0.5)
        draw_legend(drawing, axes.get_lines())
