"""How evaders move: never into something solid, never too fast, and away from pursuers."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.pursuit.evader import (
    CALM_DISTANCE,
    EVADERS,
    N_HEADINGS,
    SOLID_TOLERANCE,
    EvaderModel,
    best_heading,
    direction_table,
    look_for_pursuers,
    next_place,
    wander,
)
from swarmdata.envs.pursuit.pursuit_rules import EvaderName, PursuitRules
from swarmdata.numerics.geometry import BOX, CIRCLE, clearance
from swarmdata.registry.presets import preset
from swarmdata.types import Float

SPEC = preset("pursuit")
NOTHING = np.zeros((0, 8), np.float32)
PILLAR = np.array([[CIRCLE, 0.0, 0.0, 1.0, 0.0, 0.3, 0.3, 0.0]], np.float32)
WALL = np.array([[BOX, 0.0, 0.0, 0.6, 0.8, 0.5, 0.05, 0.0]], np.float32)

coordinate = st.floats(-1.85, 1.85)


def model_of(name: EvaderName = "lookahead") -> EvaderModel:
    return EvaderModel.of(SPEC, PursuitRules(evader=name))


def test_each_rule_has_a_name() -> None:
    assert set(EVADERS) == set(get_args(EvaderName))
    kinds = {tuple(model_of(name)[8:]) for name in get_args(EvaderName)}
    assert len(kinds) == len(EVADERS)


def test_directions_are_unit_vectors_evenly_spaced() -> None:
    table = direction_table(N_HEADINGS)
    np.testing.assert_allclose(np.hypot(*table.T), 1.0, atol=1e-11)
    np.testing.assert_allclose(
        (table * np.roll(table, 1, 0)).sum(1), np.cos(2 * np.pi / 32), atol=1e-11
    )


@given(
    x=coordinate,
    y=coordinate,
    angle=st.floats(0, 6.3),
    speed=st.floats(0, 1.2),
    robots=st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=4),
    layout=st.sampled_from([NOTHING, PILLAR, WALL]),
)
def test_evaders_never_enter_something_solid_and_never_move_too_fast(
    x: float, y: float, angle: float, speed: float, robots: list[tuple[float, float]], layout: Float
) -> None:
    model, half = model_of(), np.array(SPEC.half_size)
    if clearance(x, y, layout, half) < model.radius:
        return
    near = np.array(robots) * 0.1 + np.array([x, y])  # close enough to push
    velocity = (speed * np.cos(angle), speed * np.sin(angle))
    to_x, to_y = next_place((x, y), velocity, near, np.full(len(near), 0.1), layout, model)
    assert clearance(to_x, to_y, layout, half) >= model.radius - SOLID_TOLERANCE
    assert np.hypot(to_x - x, to_y - y) <= model.speed * model.dt + 1e-12


def test_an_evader_gives_way_to_a_robot() -> None:
    robots, radii = np.array([[0.15, 1.0]]), np.array([0.1])
    x, y = next_place((0.0, 1.0), (0.0, 0.0), robots, radii, PILLAR, model_of())
    assert (x, y) == pytest.approx((-0.05, 1.0))


def test_an_evader_flees_from_one_pursuer_and_through_the_gap_between_two() -> None:
    model = model_of()
    one = np.array([[0.5, 0.0]])
    assert model.headings[best_heading((0.0, 0.0), one, NOTHING, model)] @ (1.0, 0.0) < -0.5
    gap = np.array([[0.5, 0.5], [0.5, -0.5], [-0.6, 0.2]])
    away = model.headings[best_heading((0.0, 0.0), gap, NOTHING, model)]
    assert away[1] < -0.5  # the widest gap is below


def test_obstacles_hide_pursuers_except_from_one_that_sees_through() -> None:
    robots, seen = np.array([[0.7, 0.0], [-0.5, 0.6], [1.4, 1.4]]), np.empty((3, 2))
    place = (-0.6, 0.0)
    assert look_for_pursuers(place, robots, NOTHING, model_of(), seen)[0] == 2
    count, nearest = look_for_pursuers(place, robots, PILLAR, model_of(), seen)
    assert (count, nearest) == (1, pytest.approx(np.hypot(0.1, 0.6)))
    assert seen[0] == pytest.approx((-0.5, 0.6))
    assert look_for_pursuers(place, robots, PILLAR, model_of("all_seeing"), seen)[0] == 3
    assert look_for_pursuers(place, robots, NOTHING, model_of("short_sight"), seen)[0] == 1
    assert model_of().sight_range > CALM_DISTANCE


def test_a_calm_evader_turns_at_random_and_stands_where_something_is_ahead() -> None:
    model, free = model_of(), set()
    for bits in np.arange(0, 2**63, 2**58, dtype=np.uint64):
        ux, uy, speed = wander((0.0, 1.0), (0.0, -1.0), bits, NOTHING, model)
        assert np.hypot(ux, uy) == pytest.approx(1.0)
        assert speed == 0.15
        free.add(ux)
    assert len(free) == 32
    ux, uy, speed = wander((1.7, 0.0), (1.0, 0.0), np.uint64(2**63), NOTHING, model)
    assert speed == 0.0
    assert ux == pytest.approx(np.cos(1.0), abs=0.01)
