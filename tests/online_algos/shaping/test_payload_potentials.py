"""Paths of a payload around obstacles: at least as long as the straight line, and no dead ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.errors import SpecError
from swarmdata.online_algos.shaping.payload_potentials import PayloadPaths, PayloadPotential
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Step

SPEC = preset("transport")
PAYLOAD = SPEC.rules_as(TransportRules).payload
BODY = N_COLUMNS * SPEC.n_agents


def begin(first: int = 0) -> Step:
    return make_env(SPEC, 16).reset(np.arange(first, first + 16, dtype=np.uint64))


def mapped(step: Step) -> PayloadPaths:
    paths = PayloadPaths(SPEC, len(step.seeds))
    paths.update(step)
    return paths


def moved(step: Step, points: Double) -> Step:
    states = step.states.copy()
    states[:, BODY : BODY + 2] = points
    return step._replace(states=states)


def straight(step: Step) -> Double:
    way = step.states[:, TX : TX + 2] - step.states[:, BODY : BODY + 2]
    return np.hypot(*way.T.astype(np.float64))


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1 << 40))
def test_a_path_is_at_least_as_long_as_the_straight_line(first: int) -> None:
    step = begin(first)
    lengths = mapped(step).lengths(step)
    assert np.isfinite(lengths).all()
    # goal and point lie up to half a node's diagonal from a node; diagonals cost 7/5, not sqrt(2)
    assert (lengths >= 0.98 * straight(step) - 0.08).all()


@pytest.mark.slow
def test_behind_an_obstacle_the_path_leads_around_it() -> None:
    """A payload that touches an obstacle which lies between it and its goal."""
    step = begin()
    circle = step.layouts[:, 0]  # the first obstacle is a circle: its centre and radius
    centre, radius = circle[:, 1:3].astype(np.float64), circle[:, 5].astype(np.float64)
    goals = step.states[:, TX : TX + 2].astype(np.float64)
    away = centre - goals
    away /= np.hypot(*away.T)[:, None]
    stuck = moved(step, centre + (radius + PAYLOAD.half_length)[:, None] * away)
    paths = mapped(step)
    lengths = paths.lengths(stuck)
    known = np.isfinite(lengths)  # it may lie in a wall
    assert known.sum() > 8
    assert (lengths[known] > straight(stuck)[known] + 0.1).all()
    aside = np.stack([-away[:, 1], away[:, 0]], 1)
    sides = [paths.progress(stuck, moved(stuck, stuck.states[:, BODY : BODY + 2] + 0.3 * s))
             for s in (aside, -aside)]  # fmt: skip
    assert (np.maximum(*sides)[known] > 0).mean() > 0.8


def test_directions_point_along_the_path() -> None:
    step = begin()
    paths = mapped(step)
    directions = paths.directions(step)
    np.testing.assert_allclose(np.hypot(*directions.T), 1.0)
    ahead = moved(step, step.states[:, BODY : BODY + 2] + 0.1 * directions)
    assert (paths.progress(step, ahead) > 0.08).mean() > 0.9


def test_a_payload_in_contact_is_led_along_the_surface() -> None:
    """Nobody can push it off the surface: there is no room between."""
    step = begin()
    circle = step.layouts[:, 0].astype(np.float64)
    goals = step.states[:, TX : TX + 2].astype(np.float64)
    head_on = circle[:, 1:3] - goals
    angle = np.arctan2(head_on[:, 1], head_on[:, 0]) + 0.3
    normal = np.stack([np.cos(angle), np.sin(angle)], 1)
    distance = circle[:, 5] + PAYLOAD.half_length
    touching = moved(step, circle[:, 1:3] + distance[:, None] * normal)
    directions = mapped(touching).directions(touching)
    along = np.abs(directions[:, 0] * normal[:, 1] - directions[:, 1] * normal[:, 0])
    assert np.median(along) > 0.9


def test_robots_are_behind_a_payload_that_they_push_along_its_path() -> None:
    step = begin()
    paths = mapped(step)
    directions = paths.directions(step)
    states = step.states.copy()
    robots = robots_of(states, SPEC.n_agents)  # a view
    for number, sign in enumerate((-1, 1)):  # behind, before
        robots[:, number, : Y + 1] = states[:, BODY : BODY + 2] + sign * 0.5 * directions
    behind = paths.cosines_behind(step._replace(states=states))
    np.testing.assert_allclose(behind[:, 0], 1.0, atol=1e-5)
    np.testing.assert_allclose(behind[:, 1], -1.0, atol=1e-5)
    assert (np.abs(behind) <= 1 + 1e-9).all()


def test_paths_are_those_of_the_running_episode() -> None:
    step, other = begin(), begin(100)
    copies = np.array([1, 5])
    is_new = np.isin(np.arange(16), copies)
    mixed = step._replace(
        seeds=np.where(is_new, other.seeds, step.seeds),
        states=np.where(is_new[:, None], other.states, step.states),
        layouts=np.where(is_new[:, None, None], other.layouts, step.layouts),
    )
    paths = mapped(step)
    paths.update(mixed)
    expected = mapped(step).lengths(step)
    expected[copies] = mapped(other).lengths(other)[copies]
    np.testing.assert_array_equal(paths.lengths(mixed), expected)


def test_rewards_of_an_episode_depend_on_its_ends_only() -> None:
    env, term = make_env(SPEC, 4), PayloadPotential(SPEC, 4, path_weight=2.0, behind_weight=3.0)
    start = before = env.reset(np.arange(4, dtype=np.uint64))
    extra = np.zeros((4, 4))
    for _ in range(20):
        after = env.step(np.ones((4, 4, 2)))
        extra += term(after.rewards, before, after, 0.0) - after.rewards
        before = after
    paths = mapped(start)
    shorter = paths.lengths(start) - paths.lengths(after)
    turned = paths.cosines_behind(after) - paths.cosines_behind(start)
    np.testing.assert_allclose(extra, 2.0 * shorter[:, None] + 3.0 * turned, atol=1e-4)


def test_a_task_without_payload_is_refused() -> None:
    with pytest.raises(SpecError, match="coop_nav has none"):
        PayloadPaths(TaskSpec(), 1)
