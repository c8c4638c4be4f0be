"""Profiles: every label has a line of its own look."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing.style import family_looks
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures import profile_plot
from swarmdata.evaluation.figures.profile_plot import plot_profiles
from tests.support.drawn import shown_figure


def test_no_two_lines_look_alike_and_the_legend_is_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    families = {f"maddpg_bc-variant-{k}": f"family {k % 6}" for k in range(12)}
    thresholds = np.linspace(0.0, 100.0, 50)
    profiles = {label: np.linspace(1.0, 0.0, 50) for label in families}
    looks = family_looks(families)
    drawing = shown_figure(
        monkeypatch,
        profile_plot,
        lambda: plot_profiles(profiles, thresholds, looks, tmp_path / "a.png"),
    )
    lines = drawing.axes[0].get_lines()
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 12
    box = drawing.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= drawing.bbox.x1
    with pytest.raises(SchemaError, match="no profiles to draw"):
        plot_profiles({}, thresholds, looks, tmp_path / "b.png")
