"""Fixed layouts: distances of places, goals that mirror starts, and what is refused."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav.arrangements import arrange, unit_circle
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, TY, UX, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Step
from tests.envs.worlds import NO_OBSTACLES, arranged, check_places

KINDS = ("swap", "doorway", "corridor")


def spec_of(kind: str, n: int, goals: str = "assigned", **changes: Any) -> TaskSpec:
    arrangement = {"kind": kind, **changes.pop("arrangement", {})}
    rules = {"task": "coop_nav", "arrangement": arrangement, "goals": goals}
    return TaskSpec.parse(
        {"rules": rules, "team": [{"count": n}], "obstacles": NO_OBSTACLES, **changes}
    )


def reset(spec: TaskSpec, n_episodes: int) -> Step:
    return make_env(spec, n_episodes).reset(np.arange(n_episodes, dtype=np.uint64))


def check_episodes(spec: TaskSpec, step: Step) -> None:
    """Starts and goals keep the distances of the spec from everything."""
    s = spec.spawn
    for layout, state in zip(step.layouts, step.states, strict=True):
        robots = robots_of(state, spec.n_agents).astype(np.float64)
        starts, goals = robots[:, [X, Y]], robots[:, TX:]
        check_places(spec, layout, starts, s.start_clearance, s.start_separation)
        check_places(spec, layout, goals, s.goal_clearance, s.goal_separation)
        assert np.linalg.norm(starts - goals, axis=-1).min() >= s.min_goal_distance


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_places_keep_their_distances_for_many_seeds(kind: str, n: int) -> None:
    spec = spec_of(kind, n)
    step = reset(spec, 200)
    check_episodes(spec, step)
    starts = robots_of(step.states, n)[..., [X, Y]].reshape(200, -1)
    assert len(np.unique(starts, axis=0)) == 200


@given(
    kind=st.sampled_from(KINDS),
    n=st.integers(1, 24),
    width=st.floats(2.5, 9.0),
    height=st.floats(2.5, 9.0),
    jitter=st.floats(0.0, 0.4),
)
def test_every_spec_is_either_refused_or_valid(
    kind: str, n: int, width: float, height: float, jitter: float
) -> None:
    arena = {"width": width, "height": height}
    spec = spec_of(kind, n, arena=arena, arrangement={"jitter": jitter})
    try:
        arrange(spec)
    except SpecError:
        return
    check_episodes(spec, reset(spec, 3))


def test_goals_of_a_swap_are_opposite_and_those_of_teams_are_mirrored() -> None:
    for kind in KINDS:
        robots = robots_of(reset(spec_of(kind, 4), 20).states, 4)
        np.testing.assert_array_equal(robots[..., TX], -robots[..., X])
        sign = -1.0 if kind == "swap" else 1.0
        np.testing.assert_array_equal(robots[..., TX + 1], sign * robots[..., Y])
        if kind != "swap":
            assert (robots[:, ::2, X] < 0).all()
            assert (robots[:, 1::2, X] > 0).all()


def free_widths(spec: TaskSpec, layout: Float, x: float) -> Double:
    """y from 0 upwards to the first solid point at this x, found by stepping."""
    half = np.array([spec.arena.width / 2, spec.arena.height / 2])
    steps = np.arange(0.0, half[1], 1e-3)
    return np.array([y for y in steps if clearance(x, y, layout, half) <= 0.0])


@pytest.mark.parametrize(("kind", "width", "edge"), [("doorway", 0.5, 0.1), ("corridor", 0.8, 0.8)])
def test_the_passage_has_the_width_and_length_of_the_spec(
    kind: str, width: float, edge: float
) -> None:
    spec = spec_of(kind, 4)
    layout = reset(spec, 1).layouts[0]
    for x in (0.0, edge - 0.01, -edge + 0.01):
        solid = free_widths(spec, layout, x)
        assert solid.min() == pytest.approx(width / 2, abs=2e-3)
        assert solid.max() == pytest.approx(spec.arena.height / 2, abs=2e-3)
    assert not len(free_widths(spec, layout, edge + 0.01)[:-1])


def test_unicycles_get_headings_and_others_do_not() -> None:
    turning = {"name": "turning", "count": 2, "robot": {"dynamics": "unicycle"}}
    spec = spec_of("swap", 4, team=[{"count": 2}, turning])
    headings = robots_of(reset(spec, 20).states, 4)[..., UX : UX + 2]
    assert (headings[:, :2] == [1.0, 0.0]).all()
    np.testing.assert_allclose(np.linalg.norm(headings, axis=-1), 1.0, atol=1e-6)
    assert len(np.unique(headings[:, 2:, 0])) == 40


@pytest.mark.parametrize("n", range(1, 20))
def test_the_circle_needs_no_sine(n: int) -> None:
    angles = 2 * np.pi * np.arange(n) / n
    expected = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    np.testing.assert_allclose(unit_circle(n), expected, atol=1e-14)


LANES = preset("coop_nav-lanes")
HALF = np.array([3.0, 1.5])


def test_one_robot_fits_into_a_lane_and_two_do_not() -> None:
    layout = reset(LANES, 1).layouts[0]
    radius = LANES.robots[0].radius
    for x in (-0.89, 0.0, 0.89):
        for lane in (-0.5, 0.5):
            assert clearance(x, lane, layout, HALF) == pytest.approx(0.23, abs=1e-6)
            assert clearance(x, lane, layout, HALF) < 2 * radius
        assert clearance(x, 0.0, layout, HALF) <= 0.0
        assert clearance(x, 1.2, layout, HALF) <= 0.0
    assert clearance(1.1, 0.0, layout, HALF) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_teams_start_behind_each_other_out_of_sight_and_swap_ends(n: int) -> None:
    spec = arranged(LANES, team=[{"count": n}])
    step = reset(spec, 200)
    robots = robots_of(step.states, n).astype(np.float64)
    starts, goals = robots[..., [X, Y]], robots[..., [TX, TY]]
    np.testing.assert_array_equal(goals, starts * [-1.0, 1.0])
    assert (starts[:, ::2, 0] < -0.9).all()
    assert (starts[:, 1::2, 0] > 0.9).all()
    check_episodes(spec, step)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (spec_of("swap", 30), "neighbours on the circle"),
        (spec_of("swap", 4, arrangement={"circle_radius": 1.9}), "reaches"),
        (spec_of("swap", 4, arrangement={"circle_radius": 0.6}), "min_goal_distance"),
        (spec_of("doorway", 4, arrangement={"width": 0.3}), "at least 0.34 m for 1 robots"),
        (spec_of("corridor", 4, arrangement={"width": 0.5}), "at least 0.58 m for 2 robots"),
        (spec_of("doorway", 4, arrangement={"width": 4.5}), "less than the arena's height"),
        (spec_of("corridor", 40), "do not fit beside"),
        (spec_of("corridor", 4, arrangement={"length": 3.9}), "do not fit beside"),
        *((spec_of(kind, 4, "unassigned"), "start on goals") for kind in KINDS),
        (
            arranged(LANES, {"width": 0.3}),
            r"width is 0\.3 m, expected at least 0\.34 m and less than 0\.48",
        ),
        (arranged(LANES, {"width": 0.5}), "two do not pass each other"),
        (
            arranged(LANES, {"spread": 0.4}),
            r"spread is 0\.4 m, expected more than the lanes' width",
        ),
        (arranged(LANES, {"spread": 2.6}), "less than the arena's height without it"),
        (arranged(LANES, {"length": 4.0}), "2 robots, 0.69 m apart, do not fit beside"),
        (arranged(LANES, {"rows": [-0.25, 1.4]}), "rows of at most 1.13 m are inside"),
        (arranged(LANES, team=[{"count": 6}]), "do not fit beside arrangement 'lanes'"),
        (arranged(LANES, obstacles={}), "whose layout is fixed"),
        (
            LANES.with_updates(rules={**LANES.rules.model_dump(), "goals": "unassigned"}),
            "with arrangement 'lanes'",
        ),
    ],
)
def test_what_cannot_be_arranged_is_refused(spec: TaskSpec, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        make_task(spec)
