"""Fixed layouts that are hard to plan in: antipodal swap, doorway swap, corridor, lanes.

Only small jitters (and the rotation of a swap) depend on the episode's seed. A robot's goal is the
mirror image of its start, so that robots swap places. Starts and goals keep the distances of
`spec.spawn` by construction; the counts of `spec.obstacles` must be 0.

Swap: robot k starts at `circle_radius` (cos, sin)(2 pi k / N), jittered and then rotated; its goal
is opposite, (-x, -y). In the others even robots start left and odd ones right, with goals (-x, y),
of a wall with a door at the origin (doorway), of a passage along x between two solid blocks
(corridor), or of two such passages, in each of which one robot fits (lanes).
"""

import math
from functools import partial

import numpy as np

from swarmdata.envs.coop_nav.grid_map import walls_on_map
from swarmdata.envs.coop_nav.navigation_rules import (
    Corridor,
    Doorway,
    GridMap,
    Lanes,
    NavigationRules,
    RandomArrangement,
    Ranks,
    Swap,
)
from swarmdata.envs.coop_nav.ranks import ROUNDING_MARGIN, Place, arrange_ranks
from swarmdata.envs.world.spawn import (
    LAYOUT_OFFSET,
    check_fixed_layout,
    draw_heading,
    next_uniform,
    put_at_rest,
)
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import BOX
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds

PASSAGE_MARGIN = 0.1  # m by which a passage is wider than the robots that must fit abreast


@kernel
def _place(
    anchors: Double,  # [N, 2] starts without jitter, m
    jitter: float,  # m
    is_turned: bool,  # starts are rotated, and goals are opposite; else goals are mirrored in x
    has_heading: Bool,  # [N] whether a heading is drawn
    seeds: Seeds,  # see `Place`
    copies: Int,  # the same
    robots: Float,  # the same
) -> None:
    """Implements `Place`."""
    state = np.empty(1, np.uint64)
    for k in range(copies.shape[0]):
        b = copies[k]
        state[0] = seeds[k] + np.uint64(LAYOUT_OFFSET)
        cos, sin = 1.0, 0.0
        if is_turned:
            draw_heading(state, robots[b, 0])
            cos, sin = float(robots[b, 0, UX]), float(robots[b, 0, UY])
        for i in range(anchors.shape[0]):
            robot = robots[b, i]
            x = anchors[i, 0] + jitter * (2.0 * next_uniform(state) - 1.0)
            y = anchors[i, 1] + jitter * (2.0 * next_uniform(state) - 1.0)
            robot[X], robot[Y] = cos * x - sin * y, sin * x + cos * y
            robot[TX], robot[TY] = -robot[X], -robot[Y] if is_turned else robot[Y]
            put_at_rest(state, has_heading[i], robot)


def arrange(spec: TaskSpec) -> tuple[Float | None, Place | None]:
    """Builds the arrangement that the rules of `coop_nav` name.

    Returns:
        Its obstacles, [M, 8], and what writes starts and goals; None for what is drawn at random.

    Raises:
        SpecError: a part of the spec does not apply to the arrangement, or the robots do not fit.
    """
    rules = spec.rules_as(NavigationRules)
    kind = rules.arrangement
    if isinstance(kind, RandomArrangement):
        return None, None
    if isinstance(kind, Ranks):
        return np.zeros((0, 8), np.float32), arrange_ranks(spec, kind)
    if isinstance(kind, GridMap):
        return walls_on_map(spec, kind.rows, kind.cell), None
    if rules.goals != "assigned":
        raise SpecError(
            f"rules.goals is {rules.goals!r} with arrangement {kind.kind!r}: robots that swap "
            "places start on goals. Use goals: assigned, or arrangement: {kind: random}."
        )
    check_fixed_layout(spec, f"arrangement {kind.kind!r}")
    if isinstance(kind, Swap):
        layout, anchors = np.zeros((0, 8), np.float32), _ring(spec, kind)
    elif isinstance(kind, Doorway):
        layout, anchors = _passage(spec, kind.width, kind.thickness, 1), _sides(spec, kind)
    elif isinstance(kind, Corridor):
        layout, anchors = _passage(spec, kind.width, kind.length, 2), _sides(spec, kind)
    else:
        layout, anchors = _lane_boxes(spec, kind), _lane_starts(spec, kind)
    if isinstance(kind, Swap):
        away = kind.circle_radius - math.sqrt(2) * kind.jitter
    else:
        away = float(np.abs(anchors[:, 0]).min()) - kind.jitter
    nearest = 2.0 * away
    if nearest < spec.spawn.min_goal_distance:
        raise SpecError(
            f"goals of arrangement {kind.kind!r} can be {nearest:.2f} m from their starts, less "
            f"than spawn.min_goal_distance ({spec.spawn.min_goal_distance:g} m). Reduce either."
        )
    has_heading = np.array([robot.dynamics == "unicycle" for robot in spec.robots])
    return layout, partial(_place, anchors, kind.jitter, isinstance(kind, Swap), has_heading)


def _margins(spec: TaskSpec) -> tuple[float, float, float]:
    """Largest radius, clearance and separation for places that are both starts and goals, m."""
    s = spec.spawn
    return (
        max(robot.radius for robot in spec.robots),
        max(s.start_clearance, s.goal_clearance) + ROUNDING_MARGIN,
        max(s.start_separation, s.goal_separation) + ROUNDING_MARGIN,
    )


def unit_circle(n: int) -> Double:
    """The corners of a regular polygon, counterclockwise from (1, 0), [n, 2].

    By Taylor series: the last bit of the standard library's sine differs between platforms.
    """
    corners = np.empty((n, 2))
    for k in range(n):
        angle = 2.0 * math.pi * (k if 2 * k <= n else k - n) / n
        term, parts = 1.0, [0.0, 0.0]
        for power in range(40):
            parts[power % 2] += term if power % 4 < 2 else -term
            term = term * angle / (power + 1)
        corners[k] = parts
    return corners


def _ring(spec: TaskSpec, swap: Swap) -> Double:
    radius, clearance, separation = _margins(spec)
    anchors = swap.circle_radius * unit_circle(spec.n_agents)
    slack = math.sqrt(2) * swap.jitter
    chord = 2.0 * swap.circle_radius
    if spec.n_agents > 1:
        step = anchors[1] - anchors[0]
        chord = math.sqrt(float(step @ step))
    need = 2.0 * radius + separation + 2.0 * slack
    if chord < need:
        raise SpecError(
            f"neighbours on the circle are {chord:.2f} m apart, expected at least {need:.2f} m for "
            f"{spec.n_agents} robots. Enlarge arrangement.circle_radius or reduce its jitter."
        )
    reach = swap.circle_radius + slack + radius + clearance
    half = min(spec.arena.width, spec.arena.height) / 2
    if reach > half:
        raise SpecError(
            f"the circle with its robots reaches {reach:.2f} m from the middle of an arena whose "
            f"walls are {half:.2f} m away. Enlarge the arena or reduce arrangement.circle_radius."
        )
    return anchors


def _passage(spec: TaskSpec, width: float, length: float, n_abreast: int) -> Float:
    """Two boxes that leave a passage along x in the middle of the arena, [2, 8]."""
    need = n_abreast * 2.0 * max(robot.radius for robot in spec.robots) + PASSAGE_MARGIN
    room = spec.arena.height / 2 - width / 2
    if width < need or room <= 0.0:
        raise SpecError(
            f"arrangement.width is {width:g} m, expected at least {need:.2f} m for {n_abreast} "
            f"robots abreast and less than the arena's height ({spec.arena.height:g} m)"
        )
    middle = width / 2 + room / 2
    rows = [(BOX, 0.0, sign * middle, 1.0, 0.0, length / 2, room / 2, 0.0) for sign in (1, -1)]
    return np.array(rows, dtype=np.float32)


def _sides(spec: TaskSpec, kind: Doorway | Corridor) -> Double:
    """Returns the starts of the two teams, in columns centred on their sides, [N, 2]."""
    radius, clearance, separation = _margins(spec)
    edge = (kind.thickness if isinstance(kind, Doorway) else kind.length) / 2
    margin = radius + clearance + kind.jitter
    step = 2.0 * radius + separation + 2.0 * kind.jitter
    deep = spec.arena.width / 2 - edge - 2.0 * margin
    high = spec.arena.height - 2.0 * margin
    n_rows = int(max(high, 0.0) / step) + 1
    n_left = (spec.n_agents + 1) // 2
    n_columns = -(-n_left // n_rows)
    if deep < (n_columns - 1) * step or high < 0.0:
        raise SpecError(
            f"{n_left} robots with their distances do not fit beside arrangement {kind.kind!r}: "
            f"each side has {max(deep, 0.0):.2f} m x {max(high, 0.0):.2f} m for their centres, "
            f"which are {step:.2f} m apart. Enlarge the arena."
        )
    middle, anchors = (edge + spec.arena.width / 2) / 2, np.empty((spec.n_agents, 2))
    n_rows = -(-n_left // n_columns)
    for k in range(n_left):
        column, row = divmod(k, n_rows)
        n_in_column = min(n_rows, n_left - column * n_rows)
        place = (
            middle + (column - (n_columns - 1) / 2) * step,
            (row - (n_in_column - 1) / 2) * step,
        )
        anchors[2 * k] = -place[0], place[1]
        if 2 * k + 1 < spec.n_agents:
            anchors[2 * k + 1] = place
    return anchors


LANE_MARGIN = 0.1  # smallest excess width (m) of a lane over the robot that must fit in it


def _lane_boxes(spec: TaskSpec, lanes: Lanes) -> Float:
    """The box above the upper lane, the one below the lower, and the median, [3, 8]."""
    diameter = 2.0 * max(robot.radius for robot in spec.robots)
    if not diameter + LANE_MARGIN <= lanes.width < 2.0 * diameter:
        raise SpecError(
            f"arrangement.width is {lanes.width:g} m, expected at least {diameter + LANE_MARGIN:g} "
            f"m and less than {2.0 * diameter:g} m, so that one robot fits into a lane and two do "
            "not pass each other in it"
        )
    median = lanes.spread - lanes.width
    room = (spec.arena.height - lanes.spread - lanes.width) / 2
    if median <= 0.0 or room <= 0.0:
        raise SpecError(
            f"arrangement.spread is {lanes.spread:g} m, expected more than the lanes' width "
            f"({lanes.width:g} m) and less than the arena's height without it "
            f"({spec.arena.height - lanes.width:g} m)"
        )
    outer = (spec.arena.height - room) / 2
    rows = [(outer, room / 2), (-outer, room / 2), (0.0, median / 2)]
    boxes = [(BOX, 0.0, y, 1.0, 0.0, lanes.length / 2, half, 0.0) for y, half in rows]
    return np.array(boxes, dtype=np.float32)


def _lane_starts(spec: TaskSpec, lanes: Lanes) -> Double:
    """Starts of the two teams, one robot behind the other along x, in `lanes.rows`, [N, 2]."""
    radius, clearance, separation = _margins(spec)
    margin = radius + clearance + lanes.jitter
    step = 2.0 * radius + separation + 2.0 * lanes.jitter
    deep = (spec.arena.width - lanes.length) / 2 - 2.0 * margin
    high = spec.arena.height / 2 - margin
    n_left = (spec.n_agents + 1) // 2
    if deep < (n_left - 1) * step or max(map(abs, lanes.rows)) > high:
        raise SpecError(
            f"{n_left} robots, {step:.2f} m apart, do not fit beside arrangement 'lanes': each "
            f"side has {max(deep, 0.0):.2f} m for their row, and rows of at most {high:.2f} m are "
            f"inside the arena, got {lanes.rows}. Enlarge the arena."
        )
    anchors = np.empty((spec.n_agents, 2))
    for i in range(spec.n_agents):
        away = lanes.length / 2 + margin + (i // 2) * step
        anchors[i] = (away, lanes.rows[1]) if i % 2 else (-away, lanes.rows[0])
    return anchors
