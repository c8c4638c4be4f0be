"""The floor plan of a warehouse: shelves, places, stations, and the lengths of shortest paths.

Shelves stand in rows along x. Above each row is an aisle, and below the first row is the front with
the stations. Lanes along y connect them, at both ends of the rows and between the blocks of a row.
So a robot cannot drive straight from a station to a shelf. With two blocks and two aisles:

    +-------------------------------+
    |  o  o  o  o       o  o  o  o  |
    |                               |   aisle 2
    |  o  o  o  o       o  o  o  o  |
    |  [ shelf  ]       [ shelf  ]  |
    |  o  o  o  o       o  o  o  o  |   o: places where goods are picked, `bays` on each
    |                               |      side of an aisle
    |  o  o  o  o       o  o  o  o  |
    |  [ shelf  ]       [ shelf  ]  |
    |                               |   front
    |   s        s      s       s   |   s: stations
    +-------------------------------+
      lane       lane           lane

The length of a path is that of the shortest path of a point along the axes ("Manhattan") that
crosses no shelf. Corridors (aisles and the front) are connected only by lanes. So within a corridor
the length is |dx| + |dy|; to another corridor it is |dx| + |dy| if a lane lies between the two
points in x, and otherwise longer by twice the gap to the nearest lane. It is continuous, and a step
along a shortest path reduces it by the step's own |dx| + |dy|.
"""

from dataclasses import dataclass

import numpy as np

from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import BOX
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

STANDOFF_GAP = 0.05  # gap (m) between a shelf or wall and a robot in the middle of a place
MIN_SHELF_SIZE = 0.1  # smallest depth and length of a shelf, m
FIRST, PITCH, DEPTH = range(3)  # columns of `FloorPlan.rows`


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """Positions in metres; the origin is the arena's centre."""

    shelves: Float  # [M, 8] layout rows, from the front, each row from the left
    lanes: Double  # [blocks + 1, 2] smallest and largest x of each lane
    rows: Double  # [3] y where the first row of shelves begins, pitch of the rows, shelf depth
    middles: Double  # [aisles + 1] y of the middle of the front and of each aisle
    places: Double  # [P + K, 2] places where goods are picked, then stations
    n_picks: int  # P

    @classmethod
    def of(cls, spec: TaskSpec) -> "FloorPlan":
        """Lays out the warehouse of a spec.

        Raises:
            SpecError: the spec is another task's, or leaves no room for shelves or robots.
        """
        rules = spec.rules_as(WarehouseRules)
        width, height = spec.arena.width, spec.arena.height
        pitch = (height - rules.front) / rules.aisles
        depth = pitch - rules.aisle_width
        length = (width - (rules.blocks + 1) * rules.lane_width) / rules.blocks
        radius = max(robot.radius for robot in spec.robots)
        _check_room(rules, width, depth, length, radius)
        first = rules.front - height / 2
        left = (rules.lane_width + length) * _count(rules.blocks + 1) - width / 2
        above = first + pitch * _count(rules.aisles)
        middles = above + (depth + rules.aisle_width / 2)
        aside = max(rules.aisle_width / 2 - radius - STANDOFF_GAP, 0.0)
        bays = (_count(rules.bays) + 0.5) * length / rules.bays
        picks_x = (left[:-1, None] + rules.lane_width + bays).ravel()
        picks_y = (middles[:, None] + [-aside, aside]).ravel()
        stations_x = ((_count(rules.stations) + 0.5) / rules.stations - 0.5) * width
        stations_y = np.full(rules.stations, radius + STANDOFF_GAP - height / 2)
        picks = np.stack(np.meshgrid(picks_x, picks_y), axis=-1).reshape(-1, 2)
        stations = np.stack([stations_x, stations_y], axis=-1)
        return cls(
            shelves=_shelves(left[1:] - length / 2, above + depth / 2, length, depth),
            lanes=np.stack([left, left + rules.lane_width], axis=-1),
            rows=np.array([first, pitch, depth]),
            middles=np.array([(first - height / 2) / 2, *middles]),
            places=np.concatenate([picks, stations]),
            n_picks=len(picks),
        )


def _check_room(
    rules: WarehouseRules, width: float, depth: float, length: float, radius: float
) -> None:
    """Raises if shelves are too small, or robots do not fit in aisles, lanes or at stations."""
    for name, size in (("deep", depth), ("long", length)):
        if size < MIN_SHELF_SIZE:
            raise SpecError(
                f"shelves would be {size:.3g} m {name}, expected at least {MIN_SHELF_SIZE:g} m. "
                "Enlarge the arena, or use fewer or narrower aisles, lanes or blocks."
            )
    if rules.goal_radius >= radius + STANDOFF_GAP + depth:
        raise SpecError(
            f"goal_radius {rules.goal_radius:g} m reaches through shelves {depth:.3g} m deep. "
            f"It must be below {radius + STANDOFF_GAP + depth:.3g} m."
        )
    need = 2 * (radius + STANDOFF_GAP)
    for field in ("aisle_width", "lane_width", "front"):
        size = getattr(rules, field)
        if size < need:
            raise SpecError(
                f"{field} is {size:g} m, expected at least {need:g} m: a robot and a gap of "
                f"{STANDOFF_GAP:g} m on both sides."
            )

    if width / rules.stations < need - 1e-9:
        raise SpecError(
            f"{rules.stations} stations along {width:g} m have {width / rules.stations:.3g} m each"
            f", expected at least {need:g} m: a robot and a gap of {STANDOFF_GAP:g} m on both "
            "sides. Use fewer stations or a wider arena."
        )


def _count(n: int) -> Double:
    return np.arange(n, dtype=np.float64)


def _shelves(middle_x: Double, middle_y: Double, length: float, depth: float) -> Float:
    """Returns the boxes centred on every pair of these coordinates, row by row, [M, 8]."""
    x, y = np.meshgrid(middle_x, middle_y)
    shelves = np.zeros((x.size, 8), dtype=np.float32)
    shelves[:, 0] = BOX
    shelves[:, 1], shelves[:, 2], shelves[:, 3] = x.ravel(), y.ravel(), 1.0
    shelves[:, 5], shelves[:, 6] = length / 2, depth / 2
    return shelves


@kernel(inline="always")
def corridor(y: float, rows: Double) -> int:
    """The corridor at a height y (m): 0 for the front, k for aisle k, -1 beside shelves.

    `rows`: of the plan, [3].
    """
    up = y - rows[FIRST]
    if up < 0.0:
        return 0
    k = int(up / rows[PITCH])
    return k + 1 if up - k * rows[PITCH] >= rows[DEPTH] else -1


@kernel(inline="always")
def lane_gap(x: float, target_x: float, lanes: Double, k: int) -> float:
    """Distance from lane k to the interval between two x, m; 0 if they overlap."""
    low, high = min(x, target_x), max(x, target_x)
    return max(0.0, lanes[k, 0] - high, low - lanes[k, 1])


@kernel(inline="always")
def best_lane(x: float, target_x: float, lanes: Double) -> int:
    """Returns the lane of a shortest path to another corridor, the nearest to x of several."""
    best, least, near = 0, np.inf, np.inf
    for k in range(lanes.shape[0]):
        gap = lane_gap(x, target_x, lanes, k)
        distance = max(0.0, lanes[k, 0] - x, x - lanes[k, 1])
        if gap < least or (gap == least and distance < near):
            best, least, near = k, gap, distance
    return best


@kernel(inline="always")
def shortest_path_length(
    x: float, y: float, target_x: float, target_y: float, lanes: Double, rows: Double
) -> float:
    """Length of the shortest path along the axes that crosses no shelf, m.

    It starts outside of shelves and ends in a corridor, as all places are. `lanes` [L, 2] and
    `rows` [3] are those of the plan.
    """
    direct = abs(target_x - x) + abs(target_y - y)
    if corridor(y, rows) == corridor(target_y, rows):
        return direct
    k = best_lane(x, target_x, lanes)
    return direct + 2.0 * lane_gap(x, target_x, lanes, k)


@kernel(inline="always")
def next_corner(
    x: float, y: float, target: tuple[float, float], lanes: Double, rows: Double, middles: Double
) -> tuple[float, float]:
    """Returns the point to drive to next: the target, or the middle of a crossing before it.

    With noise, a robot may believe that it is outside the arena; beyond the last aisle counts as in
    it. `lanes` [L, 2], `rows` [3] and `middles` [aisles + 1] are those of the plan.
    """
    start = min(corridor(y, rows), middles.shape[0] - 1)
    end = corridor(target[1], rows)
    if start == end:
        return target
    k = best_lane(x, target[0], lanes)
    middle = 0.5 * (lanes[k, 0] + lanes[k, 1])
    if start < 0 or (lanes[k, 0] < x < lanes[k, 1]):
        return middle, middles[end]
    return middle, middles[start]
