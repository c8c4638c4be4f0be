"""Labels at the ends of lines keep their order and their distance."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.drawing.line_labels import spread_labels


@given(st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=9), st.floats(0.01, 0.1))
def test_labels_stay_apart_and_in_order(wanted: list[float], gap: float) -> None:
    ends = np.array(wanted)
    places = spread_labels(ends, gap)
    order = np.argsort(ends, kind="stable")
    assert (np.diff(places[order]) >= gap - 1e-9).all()
    assert places.min() >= -1e-9
    assert places.max() <= 1.0 + 1e-9


def test_labels_with_room_stay_where_they_are() -> None:
    np.testing.assert_allclose(spread_labels(np.array([0.9, 0.1, 0.5]), 0.1), [0.9, 0.1, 0.5])
    np.testing.assert_allclose(spread_labels(np.array([0.5, 0.5]), 0.1), [0.45, 0.55])
