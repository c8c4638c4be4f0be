"""The floor plan: everything fits, and way lengths are those of a search on a grid."""

from collections import deque
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmdata.envs.warehouse.floor_plan import (
    STANDOFF_GAP,
    FloorPlan,
    corridor,
    next_corner,
    shortest_path_length,
)
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Int

CELL = 0.05

Point = tuple[float, float]


def spec_of(arena: tuple[float, float] = (4.0, 4.0), **rules: Any) -> TaskSpec:
    size = {"width": arena[0], "height": arena[1]}
    return TaskSpec.parse({"rules": {"task": "warehouse", **rules}, "arena": size})


@st.composite
def plans(draw: st.DrawFn) -> tuple[TaskSpec, FloorPlan]:
    aisles, blocks = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    widths = {name: draw(st.floats(0.36, 1.2)) for name in ("aisle_width", "lane_width", "front")}
    height = widths["front"] + aisles * (widths["aisle_width"] + draw(st.floats(0.15, 0.8)))
    width = (blocks + 1) * widths["lane_width"] + blocks * draw(st.floats(0.15, 3.0))
    spec = spec_of(
        (width, height),
        aisles=aisles,
        blocks=blocks,
        bays=draw(st.integers(1, 5)),
        stations=draw(st.integers(1, min(6, int(width / 0.35)))),
        **widths,
    )
    return spec, FloorPlan.of(spec)


def half_of(spec: TaskSpec) -> Double:
    return np.array([spec.arena.width / 2, spec.arena.height / 2])


def free_point(draw: st.DrawFn, spec: TaskSpec, plan: FloorPlan) -> Point:
    half = half_of(spec)
    x, y = draw(st.floats(-half[0], half[0])), draw(st.floats(-half[1], half[1]))
    assume(clearance(x, y, plan.shelves, half) > 1e-5)
    return x, y


@st.composite
def trips(draw: st.DrawFn) -> tuple[TaskSpec, FloorPlan, Point, Point]:
    spec, plan = draw(plans())
    start, end = free_point(draw, spec, plan), free_point(draw, spec, plan)
    assume(corridor(end[1], plan.rows) >= 0)
    return spec, plan, start, end


@given(plans())
def test_shelves_and_places_are_where_they_belong(case: tuple[TaskSpec, FloorPlan]) -> None:
    spec, plan = case
    rules: Any = spec.rules
    half, radius = half_of(spec), spec.robots[0].radius
    x, y = plan.shelves[:, 1].astype(float), plan.shelves[:, 2].astype(float)
    a, b = plan.shelves[:, 5].astype(float), plan.shelves[:, 6].astype(float)
    assert (np.abs(x) + a <= half[0] + 1e-5).all()
    assert (np.abs(y) + b <= half[1] + 1e-5).all()
    overlap = (np.abs(x[:, None] - x) < a[:, None] + a - 1e-5) & (
        np.abs(y[:, None] - y) < b[:, None] + b - 1e-5
    )
    assert overlap.sum() == len(x) == rules.aisles * rules.blocks
    assert plan.n_picks == 2 * len(x) * rules.bays == len(plan.places) - rules.stations
    np.testing.assert_allclose(np.diff(plan.lanes, axis=1), rules.lane_width)
    for index, (px, py) in enumerate(plan.places):
        assert clearance(px, py, plan.shelves, half) >= radius + STANDOFF_GAP - 1e-5
        assert (corridor(py, plan.rows) > 0) == (index < plan.n_picks)


def grid_distances(free: Bool, start: tuple[int, int]) -> Int:
    """Steps along the axes from a cell to all others; -1 where there is no way."""
    steps = np.full(free.shape, -1)
    steps[start] = 0
    queue = deque([start])
    while queue:
        i, j = queue.popleft()
        for k, m in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            inside = 0 <= k < free.shape[0] and 0 <= m < free.shape[1]
            if inside and free[k, m] and steps[k, m] < 0:
                steps[k, m] = steps[i, j] + 1
                queue.append((k, m))
    return steps


@pytest.mark.parametrize("blocks", [1, 2])
def test_path_lengths_are_those_of_a_search_on_a_grid(blocks: int) -> None:
    spec = spec_of(aisles=2, blocks=blocks, aisle_width=0.8, lane_width=0.6, front=0.8)
    plan, half = FloorPlan.of(spec), half_of(spec)
    axis = np.arange(-2.0 + CELL / 2, 2.0, CELL)
    free = np.array([[clearance(x, y, plan.shelves, half) > 0.0 for y in axis] for x in axis])
    rng = np.random.default_rng(blocks)
    cells = np.argwhere(free)
    in_corridor = np.array([corridor(y, plan.rows) >= 0 for y in axis[cells[:, 1]]])
    for start in rng.choice(cells, 12, replace=False):
        steps = grid_distances(free, (int(start[0]), int(start[1])))
        assert (steps[free] >= 0).all()
        for end in rng.choice(cells[in_corridor], 60, replace=False):
            x, y, tx, ty = axis[start[0]], axis[start[1]], axis[end[0]], axis[end[1]]
            length = shortest_path_length(x, y, tx, ty, plan.lanes, plan.rows)
            # a detour turns at the lane's edge, on the grid in the first cell beside it
            assert length - 1e-9 <= CELL * steps[tuple(end)] <= length + CELL + 1e-9


@given(trips(), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_path_lengths_change_no_more_than_the_robot_moves(
    trip: tuple[TaskSpec, FloorPlan, Point, Point], dx: float, dy: float
) -> None:
    spec, plan, (x, y), target = trip
    half, end = half_of(spec), (x + dx, y + dy)
    path = np.linspace((x, y), end, 20)
    assume(all(clearance(px, py, plan.shelves, half) > 1e-5 for px, py in path))
    old = shortest_path_length(x, y, *target, plan.lanes, plan.rows)
    new = shortest_path_length(*end, *target, plan.lanes, plan.rows)
    assert abs(new - old) <= abs(dx) + abs(dy) + 1e-9


@given(trips())
def test_the_way_back_is_as_long_and_no_way_is_shorter_than_direct(
    trip: tuple[TaskSpec, FloorPlan, Point, Point],
) -> None:
    _, plan, start, end = trip
    assume(corridor(start[1], plan.rows) >= 0)
    there = shortest_path_length(*start, *end, plan.lanes, plan.rows)
    assert there == pytest.approx(shortest_path_length(*end, *start, plan.lanes, plan.rows))
    assert there >= abs(start[0] - end[0]) + abs(start[1] - end[1]) - 1e-12
    assert shortest_path_length(*end, *end, plan.lanes, plan.rows) == 0.0


@given(trips())
def test_corners_lead_to_the_target_around_shelves(
    trip: tuple[TaskSpec, FloorPlan, Point, Point],
) -> None:
    spec, plan, (x, y), target = trip
    rules: Any = spec.rules
    half, driven, step = half_of(spec), 0.0, 0.02
    slack = rules.lane_width + rules.aisle_width + rules.front + spec.arena.height
    most = shortest_path_length(x, y, *target, plan.lanes, plan.rows) + slack
    while (x, y) != target:
        corner = next_corner(x, y, target, plan.lanes, plan.rows, plan.middles)
        dx, dy = corner[0] - x, corner[1] - y
        d = float(np.hypot(dx, dy))
        x, y = corner if d <= step else (x + dx * step / d, y + dy * step / d)
        driven += min(d, step)
        assert clearance(x, y, plan.shelves, half) > -1e-9
        assert any(
            abs(x - row[1]) >= row[5] - 1e-6 or abs(y - row[2]) >= row[6] - 1e-6
            for row in plan.shelves
        )
        assert driven <= most


@given(planned=plans(), x=st.floats(-1e4, 1e4), y=st.floats(-1e4, 1e4))
def test_a_robot_that_believes_it_is_outside_is_led_back_in(
    planned: tuple[TaskSpec, FloorPlan], x: float, y: float
) -> None:
    """Noise may put a robot beyond the last aisle: memory behind the aisles was read for it."""
    _, plan = planned
    for target in plan.places:
        corner = next_corner(x, y, tuple(target), plan.lanes, plan.rows, plan.middles)
        middles = [*plan.middles, target[1]]
        assert min(abs(corner[1] - middle) for middle in middles) < 1e-9


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"aisles": 5}, "shelves would be -?0.0?1 m deep"),
        ({"blocks": 5}, "shelves would be -0.04 m long"),
        ({"aisle_width": 0.3}, "aisle_width is 0.3 m, expected at least 0.34 m"),
        ({"front": 0.2}, "front is 0.2 m, expected at least 0.34 m"),
        ({"goal_radius": 0.8}, "reaches through shelves"),
    ],
)
def test_a_floor_without_room_is_refused(rules: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        FloorPlan.of(spec_of(**rules))


def test_stations_without_room_for_a_robot_are_refused() -> None:
    FloorPlan.of(spec_of(stations=11))
    with pytest.raises(SpecError, match=r"12 stations along 4 m have .* each"):
        FloorPlan.of(spec_of(stations=12))
