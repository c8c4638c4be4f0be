"""Lines of sight against points along them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, nearest
from swarmdata.numerics.sight import is_in_sight

PLACE = st.floats(-2, 2)


@given(
    st.sampled_from([CIRCLE, BOX, CORNER, POCKET]),
    st.tuples(PLACE, PLACE),
    st.tuples(PLACE, PLACE),
    st.floats(0.2, 1.0),
    st.integers(0, 7),
)
def test_a_point_is_hidden_if_a_point_on_the_way_is_in_an_obstacle(
    kind: float, start: tuple[float, float], end: tuple[float, float], size: float, turn: int
) -> None:
    ux, uy = np.cos(turn * 0.7), np.sin(turn * 0.7)
    way = np.array(start) + np.linspace(0, 1, 400)[:, None] * (np.array(end) - start)

    def is_hit(margin: float) -> bool:
        sizes = np.array([size, size, 0.1]) + margin
        row = np.array([kind, 0.1, -0.2, ux, uy, *sizes], np.float32)
        return any(nearest(x, y, row)[0] == 0.0 for x, y in way)

    row = np.array([kind, 0.1, -0.2, ux, uy, size, size, 0.1], np.float32)
    found = is_in_sight(*start, *end, row[None])
    assert not (found and is_hit(-0.02))
    assert found or is_hit(0.02)


@pytest.mark.slow
def test_all_obstacles_count_and_none_hides_nothing() -> None:
    wall = np.array([BOX, 0, 0, 1, 0, 0.1, 1.0, 0], np.float32)
    away = np.array([CIRCLE, 5, 5, 1, 0, 0.3, 0.3, 0], np.float32)
    assert is_in_sight(-1, 0, 1, 0, np.zeros((0, 8), np.float32))
    assert is_in_sight(-1, 0, 1, 0, away[None])
    assert not is_in_sight(-1, 0, 1, 0, np.stack([away, wall]))
    assert is_in_sight(-1, 1.1, 1, 1.1, wall[None])
