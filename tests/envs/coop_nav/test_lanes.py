"""Two lanes: one robot fits into each, where the teams start, and what is refused."""

from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec

SPEC = preset("coop_nav-lanes")
HALF = np.array([3.0, 1.5])


def changed(arrangement: dict[str, Any] | None = None, **fields: Any) -> TaskSpec:
    plain = SPEC.model_dump()
    plain["rules"]["arrangement"] |= arrangement or {}
    return TaskSpec.parse({**plain, **fields})


def test_one_robot_fits_into_a_lane_and_two_do_not() -> None:
    layout = make_env(SPEC).reset(np.zeros(1, np.uint64)).layouts[0]
    radius = SPEC.robots[0].radius
    for x in (-0.89, 0.0, 0.89):
        for lane in (-0.5, 0.5):
            assert clearance(x, lane, layout, HALF) == pytest.approx(0.23, abs=1e-6)
            assert clearance(x, lane, layout, HALF) < 2 * radius
        assert clearance(x, 0.0, layout, HALF) <= 0.0
        assert clearance(x, 1.2, layout, HALF) <= 0.0
    assert clearance(1.1, 0.0, layout, HALF) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_teams_start_behind_each_other_out_of_sight_and_swap_ends(n: int) -> None:
    spec = changed(team=[{"count": n}])
    step = make_env(spec, 200).reset(np.arange(200, dtype=np.uint64))
    robots = robots_of(step.states, n).astype(np.float64)
    starts, goals, s = robots[..., [X, Y]], robots[..., [TX, TY]], spec.spawn
    np.testing.assert_array_equal(goals, starts * [-1.0, 1.0])
    assert (starts[:, ::2, 0] < -0.9).all()
    assert (starts[:, 1::2, 0] > 0.9).all()
    radius = spec.robots[0].radius
    for points, layout in zip(starts, step.layouts, strict=True):
        for x, y in points:
            assert clearance(x, y, layout, HALF) >= radius + s.goal_clearance
        gaps = np.linalg.norm(points[:, None] - points, axis=-1) - 2 * radius + 9.0 * np.eye(n)
        assert gaps.min() > max(s.goal_separation, 0.2)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            changed({"width": 0.3}),
            r"width is 0\.3 m, expected at least 0\.34 m and less than 0\.48",
        ),
        (changed({"width": 0.5}), "two do not pass each other"),
        (changed({"spread": 0.4}), r"spread is 0\.4 m, expected more than the lanes' width"),
        (changed({"spread": 2.6}), "less than the arena's height without it"),
        (changed({"length": 4.0}), "2 robots, 0.69 m apart, do not fit beside"),
        (changed({"rows": [-0.25, 1.4]}), "rows of at most 1.13 m are inside"),
        (changed(team=[{"count": 6}]), "do not fit beside arrangement 'lanes'"),
        (changed(obstacles={}), "whose layout is fixed"),
        (
            SPEC.with_updates(rules={**SPEC.rules.model_dump(), "goals": "unassigned"}),
            "with arrangement 'lanes'",
        ),
    ],
)
def test_what_does_not_fit_is_refused(spec: TaskSpec, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        make_task(spec)
