"""Arrangement `ranks`: unassigned goals that two rules share out in incompatible ways.

Rule x gives robot i the i-th goal from the left, rule y the i-th goal from the bottom, which is the
one that rule x gives robot c(i). `order` has to make c one cycle through all robots. If the robots
S follow rule y and the others rule x, all goals are covered only if c(S) = S, and a cycle leaves no
set unchanged but the empty and the full one: robots that mix the rules never cover all goals.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules, Ranks
from swarmdata.envs.world.spawn import LAYOUT_OFFSET, check_fixed_layout, next_uniform, put_at_rest
from swarmdata.errors import SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds

ROUNDING_MARGIN = 1e-5  # m between places, so that rounding to float32 cannot violate limits

Place = Callable[[Seeds, Int, Float], None]
"""Writes starts and targets of the episodes of some seeds into as many rows of robots [E, N, 8]."""


@kernel
def _place(
    starts: Double,  # [N, 2] from left to right, without jitter, m
    goals: Double,  # [N, 2] the same
    jitter: float,  # m
    has_heading: Bool,  # [N]
    seeds: Seeds,  # see `Place`
    copies: Int,  # the same
    robots: Float,  # the same
) -> None:
    """Implements `Place`."""
    state = np.empty(1, np.uint64)
    for k in range(copies.shape[0]):
        state[0] = seeds[k] + np.uint64(LAYOUT_OFFSET)
        for i in range(starts.shape[0]):
            robot = robots[copies[k], i]
            robot[X] = starts[i, 0] + jitter * (2.0 * next_uniform(state) - 1.0)
            robot[Y] = starts[i, 1] + jitter * (2.0 * next_uniform(state) - 1.0)
            robot[TX] = goals[i, 0] + jitter * (2.0 * next_uniform(state) - 1.0)
            robot[TY] = goals[i, 1] + jitter * (2.0 * next_uniform(state) - 1.0)
            put_at_rest(state, has_heading[i], robot)


def is_cycle(order: tuple[int, ...]) -> bool:
    """Whether `order` is a permutation of 0, 1, ... that is one cycle through all of them."""
    if sorted(order) != list(range(len(order))):
        return False
    at, length = order[0], 1
    while at != 0:
        at, length = order[at], length + 1
    return length == len(order)


def arrange_ranks(spec: TaskSpec, ranks: Ranks) -> Place:
    """Returns what writes the episodes of the arrangement `ranks`, which has no obstacles.

    Raises:
        SpecError: a part of the spec does not apply to it, the order is no cycle, or the robots or
            goals do not fit.
    """
    rules = spec.rules_as(NavigationRules)
    if rules.goals != "unassigned":
        raise SpecError(
            f"rules.goals is {rules.goals!r} with arrangement 'ranks', expected 'unassigned': its "
            "goals belong to nobody."
        )
    check_fixed_layout(spec, "arrangement 'ranks'")
    n, order = spec.n_agents, ranks.order
    if len(order) != n or not is_cycle(order):
        raise SpecError(
            f"arrangement.order is {list(order)}, expected a permutation of 0 to {n - 1} for {n} "
            "robots that is one cycle, so that rules for goals cannot be mixed. For 4 robots, "
            "[2, 0, 3, 1] is one."
        )
    _check_room(spec, ranks)
    middle = (n - 1) / 2
    columns = (np.arange(n) - middle) * ranks.spacing
    height = (n - 1) * ranks.spacing + ranks.distance
    rows = np.array(order) * ranks.spacing + ranks.distance - height / 2
    starts = np.stack([columns, np.full(n, -height / 2)], axis=1)
    goals = np.stack([columns, rows], axis=1)
    has_heading = np.array([robot.dynamics == "unicycle" for robot in spec.robots])
    return partial(_place, starts, goals, ranks.jitter, has_heading)


def _check_room(spec: TaskSpec, ranks: Ranks) -> None:
    """Raises if places can be too close to each other or to walls, or can exchange their ranks."""
    s, n = spec.spawn, spec.n_agents
    radius = max(robot.radius for robot in spec.robots)
    apart = 2.0 * radius + max(s.start_separation, s.goal_separation) + ROUNDING_MARGIN
    least = apart + 2.0 * ranks.jitter
    if n > 1 and ranks.spacing < least:
        raise SpecError(
            f"arrangement.spacing is {ranks.spacing:g} m, expected at least {least:.2f} m, so that "
            "robots and goals keep their distances and ranks. Enlarge it or reduce the jitter."
        )
    if ranks.distance - 2.0 * ranks.jitter < s.min_goal_distance:
        raise SpecError(
            f"arrangement.distance is {ranks.distance:g} m with a jitter of {ranks.jitter:g} m, so "
            f"goals can be nearer to starts than spawn.min_goal_distance ({s.min_goal_distance:g} "
            "m). Enlarge it or reduce either."
        )
    margin = 2.0 * (
        radius + max(s.start_clearance, s.goal_clearance) + ranks.jitter + ROUNDING_MARGIN
    )
    size = ((n - 1) * ranks.spacing + margin, (n - 1) * ranks.spacing + ranks.distance + margin)
    if size[0] > spec.arena.width or size[1] > spec.arena.height:
        raise SpecError(
            f"arrangement 'ranks' of {n} robots needs an arena of {size[0]:.2f} m x {size[1]:.2f} "
            f"m, got {spec.arena.width:g} m x {spec.arena.height:g} m. Enlarge it or reduce "
            "arrangement.spacing."
        )
