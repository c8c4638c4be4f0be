"""Maps of the episodes that run in E copies: obstacles, clearances and planned paths."""

from typing import NamedTuple

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.numerics.distance_field import (
    CLEARANCE_MARGIN,
    Ground,
    Int32,
    fill_clearances,
    grid_shape,
)
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET
from swarmdata.numerics.waypoints import UNPLANNED_COST
from swarmdata.registry.components import make_task
from swarmdata.specs.budget import in_bytes
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Step

MAX_MAP_BYTES = 1 << 31  # largest size of the maps of one episode
MAX_MAPS_BYTES = 1 << 34  # largest size of the maps of all copies together

NODE_SPACING = 0.05
"""Metres between nodes. A passage of 0.34 m leaves a strip 0.1 m wide for the centre of a robot of
radius 0.12 m; a strip as wide as the spacing holds an 8-connected chain of nodes."""


class Maps(NamedTuple):
    """Maps of E copies, each with paths to G goals."""

    primitives: Float  # [E, P, 8] convex obstacles
    clearances: Float  # [E, rows, columns] m, of the nodes
    half: Double  # [2] m, half width and half height of the arena
    costs: Int32  # [E, G, n] of the paths; see `waypoints.Paths`
    next_nodes: Int32  # [E, G, n] on the paths
    goals: Double  # [E, G, 2] m, that the paths were planned to
    are_old: Bool  # [E, G] paths from before the last reset, for the same goals only


def check_maps(spec: TaskSpec, n_copies: int, n_goals: int) -> None:
    """Raises a `SpecError` if the maps of so many episodes and goals would fill the memory."""
    rows, columns = grid_shape(spec.arena, NODE_SPACING)
    one = rows * columns * (4 + 8 * n_goals)
    if one > MAX_MAP_BYTES or n_copies * one > MAX_MAPS_BYTES:
        raise SpecError(
            f"maps of the arena of {spec.arena.width:g} x {spec.arena.height:g} m take "
            f"{in_bytes(one)} for each of {n_copies} episodes with {n_goals} goals, expected at "
            f"most {in_bytes(MAX_MAP_BYTES)} for one and {in_bytes(MAX_MAPS_BYTES)} for all. Use a "
            "smaller arena, fewer robots or fewer copies, or a policy that plans no paths."
        )


class EpisodeMaps:
    """Keeps the maps of E episodes.

    `n_goals`: G, goals in an episode. `radius`: of the largest body that paths are planned for, m.

    Raises:
        SpecError: the arena is too large to be mapped.
    """

    def __init__(self, spec: TaskSpec, n_goals: int, radius: float) -> None:
        self._spec, self._n_goals = spec, n_goals
        kinds = make_task(spec).kinds
        self._n_obstacles, self._n_primitives = len(kinds), n_primitives(kinds)
        self._cap = radius + CLEARANCE_MARGIN
        self._allocate(0)

    def _allocate(self, n_copies: int) -> None:
        check_maps(self._spec, max(n_copies, 1), self._n_goals)
        arena = self._spec.arena
        rows, columns = grid_shape(arena, NODE_SPACING)
        nodes = (n_copies, self._n_goals, rows * columns)
        self._is_mapped = np.zeros(n_copies, dtype=np.bool_)
        self._layouts = np.zeros((n_copies, self._n_obstacles, 8), dtype=np.float32)
        self.maps = Maps(
            primitives=np.zeros((n_copies, self._n_primitives, 8), dtype=np.float32),
            clearances=np.zeros((n_copies, rows, columns), dtype=np.float32),
            half=np.array([arena.width / 2.0, arena.height / 2.0]),
            costs=np.zeros(nodes, dtype=np.int32),
            next_nodes=np.zeros(nodes, dtype=np.int32),
            goals=np.zeros((n_copies, self._n_goals, 2)),
            are_old=np.ones((n_copies, self._n_goals), dtype=np.bool_),
        )

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`; paths of those mapped already are kept, as old ones."""
        if len(step.seeds) != len(self._is_mapped):
            self._allocate(len(step.seeds))
        maps = self.maps
        for b in copies:
            if self._is_mapped[b] and np.array_equal(self._layouts[b], step.layouts[b]):
                continue
            self._layouts[b] = step.layouts[b]
            self.forget_paths(b)
            maps.primitives[b] = primitives_of(step.layouts[b])
            ground = Ground(maps.clearances[b], maps.half, NODE_SPACING)
            fill_clearances(step.layouts[b], self._cap, ground)
        maps.are_old[copies] = self._is_mapped[copies] = True

    def forget_paths(self, copies: Int | int) -> None:
        """Plans the paths of `copies` anew when they are needed."""
        self.maps.costs[copies, :, 0], self.maps.goals[copies] = UNPLANNED_COST, np.inf


N_PRIMITIVES = {CIRCLE: 1, BOX: 1, CORNER: 2, POCKET: 3}


def primitives_of(layout: Float) -> Float:
    """A layout [M, 8] as circles and boxes, [P, 8]: a corner is 2 boxes, a pocket 3."""
    shapes = [_bar(row, k) for row in layout for k in range(N_PRIMITIVES[float(row[0])])]
    return np.array(shapes, dtype=np.float32).reshape(-1, 8)


def _bar(row: Float, k: int) -> Float:
    """Convex part k of an obstacle: the bar along -y, along -x, or along +x."""
    kind, x, y, ux, uy, a, b, t = (float(value) for value in row)
    if kind in (CIRCLE, BOX):
        return row
    cx, cy, hx, hy = ((0.0, t - b, a, t), (t - a, 0.0, t, b), (a - t, 0.0, t, b))[k]
    centre = (x + cx * ux - cy * uy, y + cx * uy + cy * ux)
    return np.array([BOX, *centre, ux, uy, hx, hy, 0.0], dtype=np.float32)


def n_primitives(kinds: Int) -> int:
    """Number of convex shapes in a layout whose obstacles have these shape codes, [M]."""
    return sum(N_PRIMITIVES[float(kind)] for kind in kinds)
