"""The layout of arrangement `lanes`: two parallel lanes along x, in each of which one robot fits.

Two robots that meet in a lane cannot pass each other. So the two teams get through only if each
takes a lane of its own, and all robots of a team take the same one.
"""

import numpy as np

from swarmdata.envs.coop_nav.navigation_rules import Lanes
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import BOX
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

LANE_MARGIN = 0.1
"""Smallest excess width (m) of a lane over the robot that must fit in it."""


def lane_boxes(spec: TaskSpec, lanes: Lanes) -> Float:
    """Returns the box above the upper lane, the one below the lower, and the median, [3, 8].

    Raises:
        SpecError: the lanes are too narrow or too wide, overlap or do not fit into the arena.
    """
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


def lane_starts(
    spec: TaskSpec, lanes: Lanes, radius: float, clearance: float, separation: float
) -> Double:
    """Returns the starts of the two teams, one behind the other along x, [N, 2].

    Even robots start on the left and odd ones on the right, in the rows `lanes.rows`.

    Args:
        spec: the task.
        lanes: its arrangement.
        radius: of the largest robot, m.
        clearance: between a robot and everything, m.
        separation: between robots, m.

    Raises:
        SpecError: the teams do not fit.
    """
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
