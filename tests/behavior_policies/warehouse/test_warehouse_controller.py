"""Warehouse traffic: where robots steer, who gives way, and that orders get delivered."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmdata.behavior_policies.navigation.avoidance import brake_half_planes, robot_half_planes
from swarmdata.behavior_policies.navigation.traffic import TRAFFIC_HORIZON, TRAFFIC_ROBOT_GAP
from swarmdata.behavior_policies.warehouse.warehouse_controller import (
    WarehouseController,
    lane_along,
    lane_at,
    one_way,
    roads_of,
    steer,
)
from swarmdata.envs.warehouse.floor_plan import FloorPlan, corridor
from swarmdata.envs.warehouse.warehouse import Warehouse
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds

WIDE, NARROW = preset("warehouse"), preset("warehouse-hard")
HALF = np.array([2.0, 2.0])

Point = tuple[float, float]


def steered(spec: TaskSpec, at: Point, target: Point) -> Double:
    return np.array(steer(*at, target, roads_of(spec))) - at


def follow(spec: TaskSpec, at: Point, target: Point, n_steps: int = 2000) -> Double:
    """The path of a lone point robot that slides along what it runs into, 2 cm a step."""
    plan, path = FloorPlan.of(spec), [at]
    for _ in range(n_steps):
        x, y = path[-1]
        if np.hypot(target[0] - x, target[1] - y) < 0.15:
            return np.array(path)
        to = steered(spec, (x, y), target)
        dx, dy = 0.02 * to / max(np.hypot(*to), 1e-9)
        moves = ((x + dx, y + dy), (x + dx, y), (x, y + dy), (x, y))
        path.append(next(p for p in moves if clearance(*p, plan.shelves, HALF) >= 0.12))
    raise AssertionError(f"from {at} to {target}: still at {path[-1]}")


@pytest.mark.slow
@given(st.integers(0, 1), st.floats(-1.88, 1.88), st.floats(-1.88, 1.88), st.integers(0, 35))
def test_every_place_is_reached_from_everywhere(which: int, x: float, y: float, k: int) -> None:
    spec = (WIDE, NARROW)[which]
    plan = FloorPlan.of(spec)
    assume(clearance(x, y, plan.shelves, HALF) >= 0.12)
    target = plan.places[k % len(plan.places)]
    follow(spec, (x, y), (float(target[0]), float(target[1])))


def test_robots_keep_to_the_right() -> None:
    plan = FloorPlan.of(WIDE)
    aisle, x = float(plan.middles[1]), 0.2
    assert steered(WIDE, (x, aisle), (-1.5, -1.83))[1] > 0  # to the left: above the middle
    assert steered(WIDE, (x, aisle), (1.5, -1.83))[1] < 0
    lane = float(plan.lanes[0].mean())
    assert steered(WIDE, (lane, 0.0), (0.0, 1.8))[0] > 0  # up: right of the middle
    assert steered(WIDE, (lane, 0.0), (0.0, -1.83))[0] < 0


def test_narrow_aisles_are_driven_in_one_direction() -> None:
    plan = FloorPlan.of(NARROW)
    assert [one_way(k) for k in (1, 2, 3, 4)] == [1.0, -1.0, 1.0, -1.0]
    for aisle in range(1, 5):
        for target in (plan.places[-4], plan.places[-1], plan.places[0]):
            at = (0.1, float(plan.middles[aisle]))
            if corridor(float(target[1]), plan.rows) != aisle:
                assert steered(NARROW, at, tuple(target))[0] * one_way(aisle) > 0
    picks = plan.places[: plan.n_picks]
    for x, y in picks[:: len(picks) // 8]:
        path = follow(NARROW, (0.0, -1.6), (float(x), float(y)))
        aisles = np.array([corridor(py, plan.rows) for py in path[:, 1]])
        inside = (aisles > 0) & (np.abs(path[:, 0]) < 1.2)
        steps = np.diff(path[:, 0])[inside[:-1]]
        assert (steps * one_way(corridor(y, plan.rows)) >= -1e-9).all()


def test_a_robot_that_passed_its_place_in_a_one_way_aisle_goes_round() -> None:
    plan = FloorPlan.of(NARROW)
    at, target = (0.9, float(plan.middles[1])), (-0.5, float(plan.middles[1]))
    assert steered(NARROW, at, target)[0] > 0
    path = follow(NARROW, at, target)
    assert path[:, 0].max() > 1.3  # out at the right,
    assert path[:, 1].min() < plan.rows[0]  # through the front,
    assert path[:, 0].min() < -1.3  # and in again at the left


def test_lanes_are_found_by_where_they_are() -> None:
    lanes = np.array([[-2.0, -1.5], [-0.2, 0.2], [1.5, 2.0]])
    assert [lane_at(x, lanes) for x in (-1.7, -1.0, 0.1, 0.3, 1.9)] == [0, -1, 1, -1, 2]
    assert [lane_along(x, lanes, 1.0) for x in (-1.9, -1.0, 0.3, 1.9)] == [0, 1, 2, 2]
    assert [lane_along(x, lanes, -1.0) for x in (-1.9, -1.0, 0.3, 1.9)] == [0, 0, 1, 2]


@pytest.mark.parametrize(
    ("rules", "offsets", "is_one_way"),
    [
        ({}, [0.2, 0.1550, 0.175], False),
        ({"aisle_width": 0.57}, [0.2, 0.0, 0.175], True),
        ({"aisle_width": 0.9, "front": 0.4}, [0.0, 0.225, 0.175], False),
    ],
)
def test_tracks_need_room_for_two(rules: Any, offsets: list[float], is_one_way: bool) -> None:
    roads = roads_of(preset("warehouse").with_updates(rules={"task": "warehouse", **rules}))
    np.testing.assert_allclose(roads.offsets, offsets)
    assert roads.is_one_way == is_one_way


def test_the_lower_number_has_the_right_of_way() -> None:
    robots = np.array([[0.0, 0.0, 0.3, 0.0], [0.6, 0.0, -0.3, 0.0], [5.0, 5.0, 0.0, 0.0]])
    aims = np.array([[0.6, 0.0, 0.0], [-0.6, 0.0, -1.0], [0.0, 0.0, -2.0]])
    radii, scales, planes = np.full(3, 0.12), np.ones((3, 2)), np.empty((12, 4))
    rule = (TRAFFIC_HORIZON, TRAFFIC_ROBOT_GAP)
    counts = [robot_half_planes(i, robots, radii, scales, aims, rule, 3, planes) for i in range(3)]
    assert counts == [4, 5, 3]  # nobody is near the last


@given(
    st.floats(0.2, 1.4),
    st.floats(-3, 3),
    st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)),
    st.sampled_from([1.0, 2.5]),
)
def test_brakes_bound_the_approach_and_never_forbid_to_stop(
    distance: float, slope: float, velocity: Point, slowness: float
) -> None:
    cos, sin = (1 - slope**2) / (1 + slope**2), 2 * slope / (1 + slope**2)
    offset = distance * np.array([cos, sin])
    robots = np.array([[0.3, 0.1, 0.0, 0.0], [0.3 + offset[0], 0.1 + offset[1], *velocity]])
    planes, scales = np.empty((4, 4)), np.array([[1.0, 1.0], [slowness, 1.0]])
    assert brake_half_planes(0, robots, np.full(2, 0.12), scales, 1, planes) == 2
    px, py, dx, dy = planes[1]
    leaving = max(np.dot(velocity, offset) / distance, 0.0)
    bound = max(distance - 0.25, 0.0) / (0.6 * slowness) + leaving
    for vx, vy in ((0.0, 0.0), (0.6, 0.0), (-0.3, 0.5), tuple(offset)):
        approach = (vx * offset[0] + vy * offset[1]) / distance
        inside = dx * (vy - py) - dy * (vx - px)  # how far left of the border
        assert inside == pytest.approx(bound - approach, abs=1e-9)
    assert dx * -py + dy * px >= -1e-12


class Meeting(Warehouse):
    """Two robots head-on in the first aisle, each bound for the far end of it."""

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        super().spawn(seeds, copies, layouts, states)
        robots, middle = robots_of(states, 2), self.plan.middles[1]
        robots[:, :, : Y + 1] = [[-1.0, middle], [1.0, middle]]
        robots[:, :, TX:] = [[1.6, middle], [-1.6, middle]]


def test_two_robots_pass_each_other_head_on_in_an_aisle() -> None:
    spec = WIDE.with_updates(team=[{"count": 2}])
    env, policy = TaskEnv(Meeting(spec), 1), WarehouseController(spec)
    step = env.reset(np.array([1], dtype=np.uint64))
    passed = False
    for _ in range(70):
        step = env.step(policy.act(step))
        assert not step.events.any()
        x = robots_of(step.states, 2)[0, :, 0]
        passed = passed or bool(x[0] > x[1] + 0.5)
    assert passed
