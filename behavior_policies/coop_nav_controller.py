"""The scripted controller of `coop_nav`: navigation, assignment of goals, and turns at a doorway.

Unassigned goals are assigned once, at the reset. At a doorway that one robot fits through at a
time, the left team goes first, and the right team makes room until all of it is through. Teams can
follow a convention, which coordinates a team only if all of its robots keep it: a lane on their
right (`keep-right`, the default) or left; robot i takes the i-th goal from the left (`by-x`) or
from the bottom (`by-y`).
"""

import numpy as np

from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.coop_nav.navigation_rules import (
    GOAL_CONVENTIONS,
    LANE_CONVENTIONS,
    Doorway,
    Lanes,
    NavigationRules,
)
from swarmdata.envs.coop_nav.unassigned_goals import fill_distances
from swarmdata.errors import SpecError
from swarmdata.numerics.assignment import assign, assignment_work
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step


@kernel
def assign_goals(
    states: Float, copies: Int, n: int, work: Double, places: Int, out: Double
) -> None:
    """Writes the goal of each robot, m, [E, N, 2]: the assignment with the least sum of squares.

    The squares of the distances keep any robot from having much farther to go than the others: the
    last to arrive decides. Rows `copies` of `states` [E, S] are read. `work` and `places` are the
    memory of `assignment.assign`.
    """
    costs = np.empty((n, n))
    for b in copies:
        fill_distances(states[b], n, costs)
        for i in range(n):
            for k in range(n):
                costs[i, k] *= costs[i, k]
        assign(costs, work, places)
        for i in range(n):
            first = N_COLUMNS * n + 2 * places[0, i]
            out[b, i, 0], out[b, i, 1] = states[b, first], states[b, first + 1]


def turns_at_door(robots: Float, through: float) -> Double:
    """Targets of two teams that swap sides, [E, N, 2]: the right one waits for the left, even one.

    `robots`: columns `state_layout.ROBOT`, [E, N, 8]. `through`: x (m) beyond which a robot of the
    left team is through the door.
    """
    targets = robots[..., [TX, TY]].astype(np.float64)
    waits = robots[:, ::2, X].min(axis=1) <= through
    places = robots[:, 1::2][..., [X, Y]].astype(np.float64)
    targets[:, 1::2] = np.where(waits[:, None, None], places, targets[:, 1::2])
    return targets


class CoopNavController(Scripted):
    """Navigates, assigns unassigned goals, and lets teams take turns at a doorway.

    Args:
        spec: a spec of `coop_nav`.
        noise: standard deviation of the Gaussian noise on each command.
        convention: that all robots follow; None: goals are assigned, lanes are taken on the right.

    Raises:
        SpecError: the spec is another task's, `noise` is not a standard deviation, or the task has
            no such convention.
    """

    def __init__(
        self, spec: TaskSpec, *, noise: float = 0.0, convention: str | None = None
    ) -> None:
        rules, self._n_agents = spec.rules_as(NavigationRules), spec.n_agents
        super().__init__(spec, noise=noise)
        arrangement, self._is_shared = rules.arrangement, rules.goals == "unassigned"
        self._targets: Double = np.zeros((0, spec.n_agents, 2))
        self._work = assignment_work(spec.n_agents)
        self._convention = check_convention(spec, convention)
        self._lanes = arrangement if isinstance(arrangement, Lanes) else None
        self._through: float | None = None
        if isinstance(arrangement, Doorway):
            self._through = arrangement.thickness / 2 + max(robot.radius for robot in spec.robots)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`, and assigns their goals if they are unassigned."""
        super().reset(step, copies)
        if not self._is_shared:
            return
        if len(self._targets) != len(step.seeds):
            self._targets = np.zeros((len(step.seeds), self._n_agents, 2))
        if self._convention is None:
            assign_goals(step.states, copies, self._n_agents, *self._work, self._targets)
        else:
            axis = GOAL_CONVENTIONS.index(self._convention)
            order_goals(step.states, copies, self._n_agents, axis, self._targets)

    def commands(self, step: Step) -> Double:
        targets = self._targets if self._is_shared else None
        robots = robots_of(step.states, self._n_agents)
        if self._through is not None:
            targets = turns_at_door(robots, self._through)
        if self._lanes is not None:
            targets = lane_targets(robots, self._lanes, self._convention or LANE_CONVENTIONS[0])
        return self._navigator.commands(step, targets)


PAST_LANE = 0.5  # m beyond the end of its lane that a robot aims at, so as not to brake in it


def check_convention(spec: TaskSpec, convention: str | None) -> str | None:
    """Returns `convention` if the task has it; else raises a `SpecError`."""
    known = spec.rules.conventions
    if convention is not None and convention not in known:
        raise SpecError(
            f"convention is {convention!r}, expected {' or '.join(known) or 'none'} in this task"
        )
    return convention


def lane_targets(robots: Float, lanes: Lanes, convention: str) -> Double:
    """Points that robots [E, N, 8] aim at, [E, N, 2]; even robots start on the left.

    They are the middle of its lane for a robot before it, then a point beyond the lane's end, then
    the robot's goal. `convention` is one of `LANE_CONVENTIONS`.
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
    """Writes the goal of each robot, m, [E, N, 2]: robot i takes the i-th along x (0) or y (1).

    Of goals with the same coordinate, the one with the lower number comes first. Rows `copies` of
    `states` [E, S] are read.
    """
    for b in copies:
        for k in range(n):
            first, rank = N_COLUMNS * n + 2 * k, 0
            for other in range(n):
                difference = states[b, N_COLUMNS * n + 2 * other + axis] - states[b, first + axis]
                if difference < 0.0 or (difference == 0.0 and other < k):
                    rank += 1
            out[b, rank, 0], out[b, rank, 1] = states[b, first], states[b, first + 1]
