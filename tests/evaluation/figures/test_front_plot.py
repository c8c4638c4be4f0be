"""Fronts: panels have limits of their own, and what is far away is listed."""

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing.style import family_looks
from swarmdata.evaluation.figures import front_plot
from swarmdata.evaluation.figures.front_plot import FrontPanel, plot_fronts
from tests.evaluation.figures.conftest import Shown
from tests.support.measured import at


def panel(n: int, **changes: object) -> FrontPanel:
    """The first two of n points are on the front."""
    points = {f"row_{k}": (at(float(k), 1.0), at(9.0 - k, 1.0)) for k in range(n)}
    return FrontPanel(points, ["row_0", "row_1"], **changes)  # type: ignore[arg-type]


def test_panels_have_limits_of_their_own_and_far_points_are_listed(shown: Shown) -> None:
    panels = {
        "a": panel(3, line=4.0),
        "b": panel(5, far=["row_4"]),
        "a-name-that-is-longer-than-its-panel": panel(6),
    }
    looks = family_looks({f"row_{k}": f"family {k}" for k in range(6)})
    names = {"xlabel": "cost", "ylabel": "value"}
    drawing = shown(front_plot, lambda path: plot_fronts(panels, looks, path, **names))
    first, second, third = drawing.axes
    assert first.get_ylim()[0] < 4.0 < second.get_ylim()[0], "only the first has a line there"
    assert second.get_xlim()[1] < third.get_xlim()[1]
    assert third.get_title(loc="left").count("\n") == 1
    found = {text.get_text() for text in drawing.legends[0].get_texts()}
    assert found == {*looks, "not Pareto-optimal", "mean of the data"}
    assert second.get_xlabel() == "not in view: row_4 (4.0, 5.0)"
