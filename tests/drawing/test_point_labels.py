"""Names of points cover neither each other nor markers, as long as there is room."""

from itertools import combinations

import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from matplotlib.figure import Figure

from swarmdata.drawing.point_labels import label_points

NAMED = {"first": (1.0, 1.0), "second": (1.05, 1.02), "third": (1.02, 0.97), "edge": (2.0, 2.0)}
OTHERS = [(1.2, 1.0), (0.8, 1.1)]


def test_names_are_beside_their_points_and_apart() -> None:
    drawing = Figure(figsize=(4.0, 3.0), layout="constrained")
    axes = drawing.add_subplot(xlim=(0.0, 2.0), ylim=(0.0, 2.0))
    drawing.draw_without_rendering()
    label_points(axes, NAMED, dict.fromkeys(NAMED, "black"), OTHERS, [])
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts}
    assert set(boxes) == set(NAMED)
    for one, other in combinations(boxes.values(), 2):
        assert not one.overlaps(other)
    panel = axes.get_window_extent()
    for name, box in boxes.items():
        assert panel.x0 <= box.x0
        assert box.x1 <= panel.x1
        for point in [*NAMED.values(), *OTHERS]:
            assert not box.contains(*axes.transData.transform(point)), name
