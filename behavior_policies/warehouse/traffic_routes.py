"""Where warehouse traffic goes: right-hand tracks, and one-way aisles where robots cannot pass.

Where two robots fit abreast in an aisle, each takes the shortest way (`floor_plan.best_lane`) on
the right-hand track of each corridor and lane, a quarter of its width from the middle.

In narrower aisles traffic is one-way, in the middle, so that robots never meet head-on: to the
right in odd aisles, to the left in even ones. A robot enters by the last lane before its target,
leaves by the next lane in the aisle's direction, and goes from lane to lane through the front.
"""

import numpy as np

from swarmdata.envs.warehouse.floor_plan import STANDOFF_GAP, best_lane, corridor
from swarmdata.errors import SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import WarehouseRules
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double

AHEAD = 0.4
"""Metres along its track at which a robot steers."""

CLOSING = 0.45
"""Metres along a corridor from its target below which a robot leaves the track for it."""

ABREAST = 0.1
"""Metres that two robots need besides their diameters to pass each other in an aisle."""


@kernel
def lane_at(x: float, lanes: Double) -> int:
    """The lane that x is in, or -1."""
    for k in range(lanes.shape[0]):
        if lanes[k, 0] < x < lanes[k, 1]:
            return k
    return -1


@kernel
def lane_along(x: float, lanes: Double, sign: float) -> int:
    """The first lane whose middle lies beyond x in the direction `sign`, or the last there is."""
    n = lanes.shape[0]
    for step in range(n):
        k = step if sign > 0.0 else n - 1 - step
        if (0.5 * (lanes[k, 0] + lanes[k, 1]) - x) * sign > 0.0:
            return k
    return n - 1 if sign > 0.0 else 0


@kernel(inline="always")
def one_way(aisle: int) -> float:
    """Direction of traffic in a narrow aisle: 1 to the right, -1 to the left."""
    return 1.0 if aisle % 2 == 1 else -1.0


@kernel
def steer(
    x: float,
    y: float,
    target: tuple[float, float],
    lanes: Double,
    rows: Double,
    middles: Double,
    tracks: Double,
) -> tuple[float, float]:
    """The point that a robot steers at.

    Args:
        x: m.
        y: m.
        target: m.
        lanes: of the plan, [L, 2].
        rows: of the plan, [3].
        middles: of the plan, [aisles + 1].
        tracks: how far right of the middle robots drive in the front, in aisles and in lanes, m;
            and 1 if aisles are one-way, else 0, [4].
    """
    here, there = corridor(y, rows), corridor(target[1], rows)
    inside, is_narrow = lane_at(x, lanes), tracks[3] == 1.0
    behind = is_narrow and there > 0 and (target[0] - x) * one_way(there) < 0.0
    if here == there and not behind:
        if here == 0 or abs(target[0] - x) < CLOSING:
            return target
        sign = 1.0 if target[0] > x else -1.0
        return x + sign * AHEAD, middles[here] - sign * tracks[1]
    goal, k = there, inside
    if not is_narrow:
        k = best_lane(x, target[0], lanes)
    elif inside < 0 and here > 0:
        k = lane_along(x, lanes, one_way(here))
    elif there > 0:
        k = lane_along(target[0], lanes, -one_way(there))
        if inside >= 0 and inside != k and here != 0:
            goal, k = 0, inside  # the way to another lane leads over the front
    middle = 0.5 * (lanes[k, 0] + lanes[k, 1])
    if inside == k:
        sign = 1.0 if middles[goal] > y else -1.0
        return middle + sign * tracks[2], y + sign * AHEAD
    sign = 1.0 if middle > x else -1.0
    return x + sign * AHEAD, middles[here] - sign * tracks[0 if here == 0 else 1]


def tracks_of(spec: TaskSpec) -> Double:
    """How far right of the middle robots drive, and whether aisles are one-way; see `steer`, [4].

    Raises:
        SpecError: the spec is another task's.
    """
    rules, radius = spec.rules, max(robot.radius for robot in spec.robots)
    if not isinstance(rules, WarehouseRules):
        raise SpecError(f"rules.task is {rules.task!r}, expected 'warehouse'")
    widths = np.array([rules.front, rules.aisle_width, rules.lane_width])
    aside = np.minimum(widths / 4, widths / 2 - radius - STANDOFF_GAP)
    aside[widths < 4 * radius + ABREAST] = 0.0
    return np.array([*aside, float(aside[1] == 0.0)])
