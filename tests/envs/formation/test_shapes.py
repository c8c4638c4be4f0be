"""Shapes of a formation: spacing, symmetry, and bits that no platform changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.envs.formation.shapes import check_slots, reach_of, slot_offsets
from swarmdata.errors import SpecError
from swarmdata.types import Double

SHAPES = ("line", "circle", "wedge", "column")


def gaps(offsets: Double) -> Double:
    apart = np.linalg.norm(offsets[:, None] - offsets[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    return apart


@given(shape=st.sampled_from(SHAPES), n=st.integers(1, 20), spacing=st.floats(0.3, 2.0))
def test_neighbors_are_the_spacing_apart_and_the_centre_is_the_mean(
    shape: str, n: int, spacing: float
) -> None:
    rules = FormationRules.parse({"shape": shape, "spacing": spacing})
    offsets = slot_offsets(rules, n)
    assert offsets.shape == (n, 2)
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=1e-5 * spacing)
    if n > 1:
        nearest = gaps(offsets).min(axis=1)
        np.testing.assert_allclose(nearest, spacing, rtol=2e-5)
    assert reach_of(offsets) == pytest.approx(np.linalg.norm(offsets, axis=1).max())


def test_shapes_look_as_they_are_called() -> None:
    line, circle, wedge, column = (
        slot_offsets(FormationRules.parse({"shape": shape, "spacing": 1.0}), 5) for shape in SHAPES
    )
    np.testing.assert_allclose(line, [[0, y] for y in (-2, -1, 0, 1, 2)])
    np.testing.assert_allclose(column, [[x, 0] for x in (2, 1, 0, -1, -2)])
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 0.5 / np.sin(np.pi / 5), rtol=1e-5)
    side = np.sqrt(0.5)
    arms = [[0, 0], [-side, side], [-side, -side], [-2 * side, 2 * side], [-2 * side, -2 * side]]
    np.testing.assert_allclose(wedge - wedge[0], arms, atol=1e-12)


def test_slots_in_which_robots_would_touch_are_refused() -> None:
    rules = FormationRules(spacing=0.3)
    check_slots(rules, np.array([0.1, 0.12]))
    check_slots(rules, np.array([0.2]))
    with pytest.raises(SpecError, match=r"spacing is 0.3 m, expected at least 0.35 m"):
        check_slots(rules, np.array([0.1, 0.15, 0.15]))
