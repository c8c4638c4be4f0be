"""Traffic rules of an intersection: which movements conflict, and who waits."""

import numpy as np
import pytest

from swarmdata.behavior_policies.intersection.intersection_controller import (
    APPROACHING,
    INSIDE,
    OUTSIDE,
    Rules,
    may_enter,
    movement_of,
    steer,
)
from swarmdata.registry.presets import preset
from swarmdata.types import Double

RULES = Rules.of(preset("intersection"))
EAST, NORTH, WEST, SOUTH = range(4)


def robot(x: float, y: float, goal: int, *, crosses: bool = True) -> Double:
    target = RULES.exits[goal] if crosses else RULES.entries[goal]
    return np.array([x, y, 0.0, 0.0, *target, 1.0, 0.0, float(crosses), 0.0])


def conflict(first: tuple[int, int], second: tuple[int, int]) -> bool:
    codes = tuple(4 * a + b for a, b in (first, second))
    return bool(RULES.conflicts[codes])


def test_movements_that_cross_or_merge_conflict() -> None:
    assert conflict((SOUTH, NORTH), (WEST, EAST))
    assert conflict((SOUTH, WEST), (NORTH, EAST))  # left turns of opposite arms
    assert conflict((SOUTH, EAST), (WEST, EAST))  # the same exit
    assert not conflict((SOUTH, NORTH), (NORTH, SOUTH))
    assert not conflict((SOUTH, EAST), (NORTH, WEST))  # right turns
    assert not conflict((SOUTH, NORTH), (SOUTH, EAST))  # one behind the other
    np.testing.assert_array_equal(RULES.conflicts, RULES.conflicts.T)


@pytest.mark.parametrize(
    ("at", "goal", "place", "movement"),
    [
        ((0.2, -1.0), NORTH, APPROACHING, (SOUTH, NORTH)),
        ((0.2, -0.3), NORTH, INSIDE, (SOUTH, NORTH)),
        ((0.2, 0.3), NORTH, INSIDE, (SOUTH, NORTH)),
        ((0.2, 0.5), NORTH, OUTSIDE, None),
        ((0.2, -0.3), WEST, INSIDE, (SOUTH, WEST)),
        ((0.0, 0.2), WEST, INSIDE, (EAST, WEST)),  # on the lane that it leaves by
    ],
)
def test_a_robot_is_where_it_is_on_its_way(
    at: tuple[float, float], goal: int, place: int, movement: tuple[int, int] | None
) -> None:
    found, code, _ = movement_of(robot(*at, goal), RULES)
    assert found == place
    if movement is not None:
        assert code == 4 * movement[0] + movement[1]


def test_robots_wait_for_those_inside_and_for_those_that_came_first() -> None:
    south, west = robot(0.2, -0.7, NORTH), robot(-0.8, -0.2, EAST)
    assert may_enter(0, np.stack([south, west]), RULES)
    assert not may_enter(1, np.stack([south, west]), RULES)
    inside = robot(0.0, -0.2, EAST)
    assert not may_enter(0, np.stack([south, inside]), RULES)
    tie = robot(-0.7, -0.2, EAST)
    assert [may_enter(i, np.stack([south, tie]), RULES) for i in (0, 1)] == [True, False]


def test_robots_wait_for_a_full_exit_arm() -> None:
    queue = [robot(0.2, 0.6 + 0.34 * k, NORTH, crosses=False) for k in range(RULES.capacity)]
    south = robot(0.2, -0.7, NORTH)
    assert may_enter(0, np.stack([south, *queue[1:]]), RULES)
    assert not may_enter(0, np.stack([south, *queue]), RULES)


def test_robots_halt_at_the_stop_line_and_keep_to_the_right() -> None:
    south, west = robot(0.15, -0.8, NORTH), robot(-0.65, -0.2, EAST)
    assert steer(0, np.stack([south, west]), RULES) == pytest.approx((0.2, -RULES.stop_line))
    assert steer(0, np.stack([south]), RULES) == pytest.approx((0.2, -0.45))
    turning = np.stack([robot(0.2, -0.1, WEST)])
    assert steer(0, turning, RULES) == pytest.approx((0.2, 0.2))


def test_a_robot_behind_its_exit_goes_to_its_entry_once_that_is_free() -> None:
    left = robot(-0.2, -1.75, SOUTH, crosses=False)
    assert steer(0, np.stack([left]), RULES) == pytest.approx((0.2, -1.83))
    waiting = robot(0.2, -1.83, SOUTH, crosses=False)
    assert steer(0, np.stack([left, waiting]), RULES) == pytest.approx((-0.2, -1.83))
