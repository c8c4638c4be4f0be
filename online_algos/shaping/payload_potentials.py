"""PayloadPotential, rewards for a payload's progress along its path and for pushing from behind.

In a straight line to its goal, a payload meets dead ends: it loses reward for every way out. The
length of the shortest path around obstacles has none. Robots that push from all sides are another
one, so they may also be rewarded for getting behind the payload, seen along its path. Both are
potentials (Ng, Harada and Russell, "Policy invariance under reward transformations", ICML 1999,
theorem 1, without the discount).
"""

import numpy as np

from swarmdata.behavior_policies.navigation.episode_maps import NODE_SPACING, check_maps
from swarmdata.envs.transport.payload import payload_radius
from swarmdata.errors import SpecError
from swarmdata.numerics.distance_field import (
    STRAIGHT_COST,
    Ground,
    fill_clearances,
    fill_paths,
    grid_shape,
    nearest_node,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds, Step

CONTACT_OVERLAP = 0.02
"""How far a payload that touches a surface may seem to overlap it, m."""

DIRECTION_STEP = 0.1
"""Distance to both sides of a point at which path lengths are compared for their direction, m."""

NODE_REACH = 2
"""Nodes around a point that are searched for the shortest path."""


@kernel
def fill_lengths(
    layouts: Float, goals: Double, half: Double, radius: float, copies: Int, out: Double
) -> None:
    """Writes the length of the path to the goal from every node of some copies, m.

    `out` is [C, rows, columns], infinite where there is no path. Obstacles are [C, M, 8], goals, m,
    [C, 2], `half` half width and half height of the arena, m, [2]; the payload has a radius, m.
    """
    rows, columns = out.shape[1:]
    grid = np.empty((rows, columns), np.float32)
    ground = Ground(grid, half, NODE_SPACING)
    weights = np.empty(rows * columns, np.int32)
    costs = np.empty(rows * columns, np.int32)
    paths = np.empty(rows * columns, np.int32)
    for c in copies:
        fill_clearances(layouts[c], radius + NODE_SPACING, ground)
        for row in range(rows):
            for column in range(columns):
                gap = grid[row, column] - radius
                is_inside = 0 < row < rows - 1 and 0 < column < columns - 1
                weights[row * columns + column] = 1 if is_inside and gap > -CONTACT_OVERLAP else 0
        end = nearest_node(goals[c, 0], goals[c, 1], weights - 1, ground)
        costs[:] = -1
        if end >= 0:
            fill_paths(end, columns, weights, costs, paths)
        for node in range(rows * columns):
            length = costs[node] * NODE_SPACING / STRAIGHT_COST
            out[c, node // columns, node % columns] = length if costs[node] >= 0 else np.inf


@kernel
def look_up(points: Double, half: Double, lengths: Double, out: Double) -> None:
    """Writes the length, m, [C], of the shortest path from points over one of the nodes around.

    It is infinite where no node around has a path. Points, m, are [C, 2], `half` is half width and
    half height of the arena, m, [2], `lengths` are those of the paths from the nodes, m, [C, rows,
    columns].
    """
    rows, columns = lengths.shape[1:]
    for c in range(points.shape[0]):
        u, v = (points[c, 0] + half[0]) / NODE_SPACING, (points[c, 1] + half[1]) / NODE_SPACING
        out[c] = np.inf
        for row in range(max(int(v) - NODE_REACH, 0), min(int(v) + NODE_REACH + 2, rows)):
            for column in range(max(int(u) - NODE_REACH, 0), min(int(u) + NODE_REACH + 2, columns)):
                dx, dy = column - u, row - v
                length = np.sqrt(dx * dx + dy * dy) * NODE_SPACING + lengths[c, row, column]
                out[c] = min(out[c], length)


class PayloadPotential:
    """Adds w_path (length before - length after) + w_behind (cos after - cos before).

    The length is that of the payload's path to its goal, in metres, the cosine that of the angle
    between the path's direction and the line from the robot to the payload. The path's term is 0 in
    steps from or to a place without a path.
    """

    def __init__(
        self, spec: TaskSpec, n_copies: int, path_weight: float, behind_weight: float
    ) -> None:
        self.paths = PayloadPaths(spec, n_copies)
        self.path_weight, self.behind_weight = path_weight, behind_weight

    def __call__(self, rewards: Float, before: Step, after: Step, progress: float) -> Float:
        """Returns the rewards with both potentials, [E, N]."""
        paths = self.paths
        paths.update(before)
        shorter = paths.progress(before, after)[:, None]
        turned = paths.cosines_behind(after) - paths.cosines_behind(before)
        extra = self.path_weight * shorter + self.behind_weight * turned
        changed: Float = rewards + extra.astype(np.float32)
        return changed


class PayloadPaths:
    """The payload's shortest paths in the episodes that run in C copies."""

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        payload = getattr(spec.rules, "payload", None)
        if payload is None:
            raise SpecError(
                "payload_path_weight and behind_payload_weight are for tasks with a payload, "
                f"{spec.task} has none"
            )
        self._first = N_COLUMNS * spec.n_agents  # where the payload's state begins
        self._half = np.array([spec.arena.width, spec.arena.height]) / 2
        self._radius = payload_radius(payload)
        check_maps(spec, n_copies, 1)
        self._lengths = np.empty((n_copies, *grid_shape(spec.arena, NODE_SPACING)))
        self._seeds: Seeds | None = None  # of the episodes that `_lengths` belong to, [C]

    def update(self, step: Step) -> None:
        """Maps the episodes that have begun; their obstacles and goals follow from their seeds."""
        seeds, old = step.seeds, self._seeds
        copies = np.arange(len(seeds)) if old is None else np.flatnonzero(old != seeds)
        if len(copies):
            goals = step.states[:, TX : TX + 2].astype(np.float64)
            fill_lengths(step.layouts, goals, self._half, self._radius, copies, self._lengths)
            self._seeds = seeds.copy()

    def lengths(self, step: Step) -> Double:
        """Length of the payload's path in every copy, m, [C]; infinite where there is none."""
        points = step.states[:, self._first : self._first + 2].astype(np.float64)
        out = np.empty(len(points))
        look_up(points, self._half, self._lengths, out)
        return out

    def directions(self, step: Step) -> Double:
        """Direction of the payload's path in every copy, unit vectors [C, 2]; 0 without a path.

        Paths follow a grid, so directions are up to 22.5 degrees off the shortest way in the open.
        """
        points = step.states[:, self._first : self._first + 2].astype(np.float64)
        slopes = np.zeros_like(points)
        sides = np.empty((2, len(points)))
        for axis in range(2):
            for side, sign in zip(sides, (-1.0, 1.0), strict=True):
                shifted = points.copy()
                shifted[:, axis] += sign * DIRECTION_STEP
                look_up(shifted, self._half, self._lengths, side)
            is_known = np.isfinite(sides).all(0)
            np.subtract(sides[0], sides[1], out=slopes[:, axis], where=is_known)
        return slopes / np.maximum(np.hypot(*slopes.T), 1e-9)[:, None]

    def cosines_behind(self, step: Step) -> Double:
        """How far robots are behind the payload, [C, N]: 1 behind it on its path, -1 in front."""
        robots = robots_of(step.states, step.rewards.shape[1])[..., : Y + 1].astype(np.float64)
        payload = step.states[:, None, self._first : self._first + 2].astype(np.float64)
        arms = payload - robots
        lengths = np.maximum(np.hypot(arms[..., 0], arms[..., 1]), 1e-9)
        cosines: Double = (arms * self.directions(step)[:, None]).sum(-1) / lengths
        return cosines

    def progress(self, before: Step, after: Step) -> Double:
        """How much shorter the payload's path has become, m, [C]; 0 where there is none."""
        old, new = self.lengths(before), self.lengths(after)
        is_known = np.isfinite(old) & np.isfinite(new)
        return np.subtract(old, new, out=np.zeros_like(old), where=is_known)
