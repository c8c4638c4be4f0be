"""Unassigned goals of `coop_nav`: which robot covers which goal, rewards, and observations.

A goal is covered while a robot is within the goal radius, `radius`. Goals are more than two radii
apart, so a robot covers at most one.
"""

import math

import numpy as np

from swarmdata.numerics.assignment import assign
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, leading_to_places, numbered, telling_goals, vector
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY
from swarmdata.types import Bool, Double, Float, Int

GOAL_FEATURES = (
    *leading_to_places(vector("offset", "position", "goal minus own position, m")),
    Feature("is_taken", "flag", meaning="1 if another robot covers it"),
)
"""A robot's observation of each goal."""

N_GOAL_FEATURES = len(GOAL_FEATURES)


def goal_features(n_goals: int) -> tuple[Feature, ...]:
    """Features of all goals, the one nearest to the robot first."""
    return telling_goals(numbered("goal", n_goals, GOAL_FEATURES))


@kernel(inline="always")
def goal_distance(state: Float, n: int, i: int, k: int) -> float:
    """Distance from robot i to goal k, m."""
    dx = float(state[N_COLUMNS * n + 2 * k]) - float(state[N_COLUMNS * i])
    dy = float(state[N_COLUMNS * n + 2 * k + 1]) - float(state[N_COLUMNS * i + 1])
    return math.sqrt(dx * dx + dy * dy)


@kernel
def _holders(state: Float, n: int, radius: float, holders: Int) -> int:
    """Writes the first robot that covers each goal, or -1, and returns the number of open goals."""
    n_open = 0
    for k in range(n):
        holders[k] = -1
        for i in range(n):
            if goal_distance(state, n, i, k) <= radius:
                holders[k] = i
                break
        n_open += holders[k] < 0
    return n_open


@kernel
def _aim(state: Float, n: int, holders: Int) -> None:
    """Writes each robot's target: the nearest goal that nobody holds, but perhaps itself."""
    for i in range(n):
        nearest, target = math.inf, 0
        for k in range(n):
            distance = goal_distance(state, n, i, k)
            if (holders[k] < 0 or holders[k] == i) and distance < nearest:
                nearest, target = distance, k
        state[N_COLUMNS * i + TX] = state[N_COLUMNS * n + 2 * target]
        state[N_COLUMNS * i + TY] = state[N_COLUMNS * n + 2 * target + 1]


@kernel
def fill_distances(state: Float, n: int, out: Double) -> None:
    """Writes the distance of every robot (row) to every goal (column), m, [N, N]."""
    for i in range(n):
        for k in range(n):
            out[i, k] = goal_distance(state, n, i, k)


@kernel
def share_goals(states: Float, copies: Int, n: int, radius: float) -> None:
    """Turns the targets of newly spawned states [E, S] into unassigned goals, in the rows `copies`.

    `radius`: of goals, m.
    """
    holders = np.empty(n, np.int64)
    for b in copies:
        for i in range(n):
            states[b, N_COLUMNS * n + 2 * i] = states[b, N_COLUMNS * i + TX]
            states[b, N_COLUMNS * n + 2 * i + 1] = states[b, N_COLUMNS * i + TY]
        _holders(states[b], n, radius, holders)
        _aim(states[b], n, holders)


@kernel
def score_coverage(
    before: Float,  # [E, S] states before the step
    after: Float,  # [E, S] states after the step; targets are written
    active: Bool,  # [E]
    radius: float,  # of goals, m
    scratch: tuple[Double, Double, Int],  # overwritten: costs [N, N]; memory of `assign`
    terms: Float,  # [E, N, R] progress and time are written
    solved: Bool,  # [E] written
) -> None:
    """Writes targets, the task's own terms, and whether all goals are covered, in active copies."""
    n = terms.shape[1]
    costs, work, places = scratch
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        fill_distances(before[b], n, costs)
        old = assign(costs, work, places)
        fill_distances(after[b], n, costs)
        new = assign(costs, work, places)
        n_open = _holders(after[b], n, radius, places[0])
        _aim(after[b], n, places[0])
        for i in range(n):
            terms[b, i, 0], terms[b, i, 1] = (old - new) / n, n_open / n
        solved[b] = n_open == 0


@kernel
def write_goal_features(states: Float, active: Bool, n: int, radius: float, out: Float) -> None:
    """Writes `goal_features` of every robot of the active copies, [E, N, 3 N], by states [E, S].

    `radius`: of goals, m.
    """
    holders, order, distances = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state = states[b]
        _holders(state, n, radius, holders)
        for i in range(n):
            for k in range(n):
                distance, slot = goal_distance(state, n, i, k), k
                while slot > 0 and distances[slot - 1] > distance:
                    distances[slot], order[slot] = distances[slot - 1], order[slot - 1]
                    slot -= 1
                distances[slot], order[slot] = distance, k
            for slot in range(n):
                k, first = order[slot], N_GOAL_FEATURES * slot
                for c in range(2):
                    goal = float(state[N_COLUMNS * n + 2 * k + c])
                    out[b, i, first + c] = goal - float(state[N_COLUMNS * i + c])
                out[b, i, first + 2] = 1.0 if holders[k] >= 0 and holders[k] != i else 0.0
