"""The way of a payload around obstacles to its goal, as potentials to train on.

The task rewards a payload for coming nearer to its goal in a straight line, so a policy that has
pushed it against an obstacle loses reward for every way out. The length of the way around has no
such dead ends. Another dead end are robots that push from all sides: nothing moves, and who lets go
earns nothing. So robots may also be rewarded for getting behind the payload, seen along its way.
Both are potentials (Ng, Harada and Russell, "Policy invariance under reward transformations", ICML
1999, theorem 1, without the discount): what an episode earns depends on its first and last state
only.
"""

import numpy as np

from swarmdata.behavior_policies.navigation.distance_field import (
    NODE_SPACING,
    STRAIGHT_COST,
    check_maps,
    fill_clearances,
    fill_paths,
    grid_shape,
    nearest_node,
)
from swarmdata.envs.transport.payload import payload_radius
from swarmdata.errors import SpecError
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

SLACK = 0.02
"""Metres by which the payload may seem to overlap a surface that it touches."""

STRIDE = 0.1
"""Metres to both sides of a point over which a way's length is compared, for its direction."""

REACH = 2
"""Nodes around a point that are looked at for the shortest way."""


@kernel
def fill_lengths(
    layouts: Float, goals: Double, half: Double, radius: float, copies: Int, out: Double
) -> None:
    """Writes the length of the way to the goal from every node, infinite where there is none.

    Args:
        layouts: obstacles of all copies, [C, M, 8].
        goals: of all copies, m, [C, 2].
        half: half width and half height of the arena, m, [2].
        radius: of the payload, m.
        copies: whose ways are written.
        out: written, m, [C, rows, columns].
    """
    rows, columns = out.shape[1:]
    grid = np.empty((rows, columns), np.float32)
    weights = np.empty(rows * columns, np.int32)
    costs = np.empty(rows * columns, np.int32)
    ways = np.empty(rows * columns, np.int32)
    for c in copies:
        fill_clearances(layouts[c], half, radius + NODE_SPACING, grid)
        for row in range(rows):
            for column in range(columns):
                gap = grid[row, column] - radius
                is_inside = 0 < row < rows - 1 and 0 < column < columns - 1
                weights[row * columns + column] = 1 if is_inside and gap > -SLACK else 0
        end = nearest_node(goals[c, 0], goals[c, 1], weights - 1, columns, half)
        costs[:] = -1
        if end >= 0:
            fill_paths(end, columns, weights, costs, ways)
        for node in range(rows * columns):
            length = costs[node] * NODE_SPACING / STRAIGHT_COST
            out[c, node // columns, node % columns] = length if costs[node] >= 0 else np.inf


@kernel
def look_up(points: Double, half: Double, lengths: Double, out: Double) -> None:
    """Writes the shortest way from each point over one of the nodes around it.

    Args:
        points: m, [C, 2].
        half: half width and half height of the arena, m, [2].
        lengths: of the ways from the nodes, m, [C, rows, columns].
        out: written, m, [C]; infinite where no node around has a way.
    """
    rows, columns = lengths.shape[1:]
    for c in range(points.shape[0]):
        u, v = (points[c, 0] + half[0]) / NODE_SPACING, (points[c, 1] + half[1]) / NODE_SPACING
        out[c] = np.inf
        for row in range(max(int(v) - REACH, 0), min(int(v) + REACH + 2, rows)):
            for column in range(max(int(u) - REACH, 0), min(int(u) + REACH + 2, columns)):
                dx, dy = column - u, row - v
                way = np.sqrt(dx * dx + dy * dy) * NODE_SPACING + lengths[c, row, column]
                out[c] = min(out[c], way)


class Detours:
    """Lengths of the payload's ways in the episodes that run in C copies.

    Args:
        spec: of a task with a payload.
        step: the present one of all copies.

    Raises:
        SpecError: the task has no payload.
    """

    def __init__(self, spec: TaskSpec, step: Step) -> None:
        payload = getattr(spec.rules, "payload", None)
        if payload is None:
            raise SpecError(f"detour and behind are for tasks with a payload, {spec.task} has none")
        self._first = N_COLUMNS * spec.n_agents  # where the payload's state begins
        self._half = np.array([spec.arena.width, spec.arena.height]) / 2
        self._radius = payload_radius(payload)
        check_maps(spec, len(step.seeds), 1)
        self._lengths = np.empty((len(step.seeds), *grid_shape(spec)))
        self.begin(step, np.arange(len(step.seeds)))

    def begin(self, step: Step, copies: Int) -> None:
        """Finds the ways of the episodes that have begun in some copies."""
        goals = step.states[:, TX : TX + 2].astype(np.float64)
        fill_lengths(step.layouts, goals, self._half, self._radius, copies, self._lengths)

    def lengths(self, step: Step) -> Double:
        """Length of the payload's way in every copy, m, [C]; infinite where there is none."""
        points = step.states[:, self._first : self._first + 2].astype(np.float64)
        out = np.empty(len(points))
        look_up(points, self._half, self._lengths, out)
        return out

    def directions(self, step: Step) -> Double:
        """Where the payload's way leads in every copy, unit vectors [C, 2]; 0 where there is none.

        Of ways along a grid, so up to 22.5 degrees off the shortest one in the open.
        """
        points = step.states[:, self._first : self._first + 2].astype(np.float64)
        slopes = np.zeros_like(points)
        sides = np.empty((2, len(points)))
        for axis in range(2):
            for side, sign in zip(sides, (-1.0, 1.0), strict=True):
                aside = points.copy()
                aside[:, axis] += sign * STRIDE
                look_up(aside, self._half, self._lengths, side)
            is_known = np.isfinite(sides).all(0)
            np.subtract(sides[0], sides[1], out=slopes[:, axis], where=is_known)
        return slopes / np.maximum(np.hypot(*slopes.T), 1e-9)[:, None]

    def behind(self, step: Step) -> Double:
        """How far robots are behind the payload, [C, N]: 1 if it lies along its way, -1 before."""
        robots = robots_of(step.states, step.rewards.shape[1])[..., : Y + 1].astype(np.float64)
        payload = step.states[:, None, self._first : self._first + 2].astype(np.float64)
        arms = payload - robots
        lengths = np.maximum(np.hypot(arms[..., 0], arms[..., 1]), 1e-9)
        cosines: Double = (arms * self.directions(step)[:, None]).sum(-1) / lengths
        return cosines

    def progress(self, before: Step, after: Step) -> Double:
        """How much shorter the payload's way has become, m, [C]; 0 where there is none."""
        old, new = self.lengths(before), self.lengths(after)
        is_known = np.isfinite(old) & np.isfinite(new)
        return np.subtract(old, new, out=np.zeros_like(old), where=is_known)
