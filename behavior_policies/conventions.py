"""Conventions of scripted teams: rules that coordinate a team only if all of its robots keep them.

Lanes: robots that `keep-right` take the lane on their right, those that `keep-left` the other one.
Unassigned goals: robot i takes the i-th goal from the left (`by-x`), or from the bottom (`by-y`).
"""

import numpy as np

from swarmdata.envs.coop_nav.navigation_rules import Lanes
from swarmdata.errors import SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int

PAST_LANE = 0.5
"""Metres beyond the end of its lane that a robot aims at, so that it does not brake in the lane."""


def check_convention(spec: TaskSpec, convention: str | None) -> str | None:
    """Returns `convention` if the task has it.

    Raises:
        SpecError: it has not.
    """
    known = spec.rules.conventions
    if convention is not None and convention not in known:
        raise SpecError(
            f"convention is {convention!r}, expected {' or '.join(known) or 'none'} in this task"
        )
    return convention


def lane_targets(robots: Float, lanes: Lanes, convention: str) -> Double:
    """Returns the points that robots aim at, [E, N, 2].

    They are the middle of its lane for a robot before it, then a point beyond the lane's end, then
    the robot's goal.

    Args:
        robots: columns `state_layout.ROBOT`, [E, N, 8]; even robots start on the left.
        lanes: the arrangement.
        convention: one of `LANE_CONVENTIONS`.
    """
    targets = robots[..., [TX, TY]].astype(np.float64)
    heading = np.where(np.arange(robots.shape[1]) % 2 == 0, 1.0, -1.0)
    side = -heading if convention == "keep-right" else heading
    end, lane = lanes.length / 2, np.broadcast_to(side * (lanes.spread / 2), robots.shape[:2])
    along = heading * robots[..., X]
    aim = heading * np.where(along < -end, 0.0, end + PAST_LANE)
    is_through = (along > end)[..., None]
    return np.where(is_through, targets, np.stack([aim, lane], axis=-1))


@kernel
def order_goals(states: Float, copies: Int, n: int, axis: int, out: Double) -> None:
    """Writes the goal of each robot: robot i takes the i-th along an axis, ties by their numbers.

    Args:
        states: [E, S].
        copies: rows to read and write.
        n: number of robots and goals.
        axis: 0 for x, 1 for y.
        out: written, m, [E, N, 2].
    """
    for b in copies:
        for k in range(n):
            first, rank = N_COLUMNS * n + 2 * k, 0
            for other in range(n):
                difference = states[b, N_COLUMNS * n + 2 * other + axis] - states[b, first + axis]
                if difference < 0.0 or (difference == 0.0 and other < k):
                    rank += 1
            out[b, rank, 0], out[b, rank, 1] = states[b, first], states[b, first + 1]
