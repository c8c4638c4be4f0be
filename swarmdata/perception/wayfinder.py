"""Ways: where to drive to each place that an observation tells, how far it is, and who is nearer.

They are a function of the layout, of where the robot believes to be and of the place
(`ways_definition`); other robots and movable bodies are not on the map.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.numerics.distance_field import (
    CLEARANCE_MARGIN,
    DIAGONAL_COST,
    GAP_LEVELS,
    GAP_WEIGHTS,
    STRAIGHT_COST,
    Ground,
    Int32,
    fill_clearances,
    grid_shape,
)
from swarmdata.numerics.waypoints import (
    LOOKAHEAD_NODES,
    Paths,
    farthest_visible_node,
    free_distance,
    is_visible,
    plan,
    position_of,
)
from swarmdata.perception.sensing.state import GOAL_NEAR
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, vector
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, UY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Step

NODE_SPACING = 0.1
"""Metres between the nodes of the map. A passage of 0.34 m leaves a strip as wide for the centre of
a robot of radius 0.12 m."""

WAY_GAP = 0.05
"""Metres of free gap that a straight piece of a way keeps where it can, to go wide at corners."""

N_WAY_FEATURES = 4
"""Numbers for each place: two of the direction, the length, and how many robots are nearer."""

OWN_TARGET = -1
"""Stands for the column of a place: the robot's own target, which is in its measured state."""

NO_NODE = -1


class Guide(NamedTuple):
    """Constants of a task."""

    places: Int  # [P] columns of the x components of vectors that lead to places, or `OWN_TARGET`
    senders: Int  # [K, 2] columns of the x components of where senders were, and of their masks
    n_others: int  # robots of the team besides one
    half: Double  # [2] m, half width and half height of the arena
    radius: float  # m, of the largest robot
    diagonal: float  # m, of the arena
    in_body: bool  # vectors are in the robots' body frames
    delay: int  # control steps, of the sensors
    goal_steps: int  # sensed steps that show the own target


class Plans(NamedTuple):
    """Maps of E copies, and the paths to the G places that were asked for last."""

    layouts: Float  # [E, M, 8] of the maps
    clearances: Float  # [E, rows, columns] m, of the nodes
    ends: Int32  # [E, G] nodes that the paths lead to, or `NO_NODE`
    uses: Int  # [E, G] when each was used last
    clocks: Int  # [E] uses so far
    costs: Int32  # [E, G, n] of the paths, with `UNPLANNED_COST`
    next_nodes: Int32  # [E, G, n] on the paths


class Wayfinder:
    """Adds the ways to the observations of E copies, whose other features are `sensed`."""

    def __init__(self, task: Task, sensed: Sequence[Feature], n_copies: int) -> None:
        spec = task.spec
        places = {
            feature.name.removesuffix("_x"): column
            for column, feature in enumerate(sensed)
            if feature.is_place and feature.axis == "x" and not feature.name.endswith("]")
        }
        model, (half_width, half_height) = spec.observation, spec.half_size
        never = np.iinfo(np.int64).max
        self.features = tuple(
            way
            for name, place in (("own.goal", "target"), *((name, name) for name in places))
            for way in _way_features(name, place)
        )
        self._guide = Guide(
            places=np.array([OWN_TARGET, *places.values()], dtype=np.int64),
            senders=_senders([feature.name for feature in sensed]),
            n_others=max(spec.n_agents - 1, 1),
            half=np.array([half_width, half_height]),
            radius=max(robot.radius for robot in spec.robots),
            diagonal=2.0 * math.sqrt(half_width * half_width + half_height * half_height),
            in_body=model.in_body_frame,
            delay=model.delay,
            goal_steps=never if model.goal_steps is None else model.goal_steps,
        )
        self._plans = _no_plans(task, n_copies)

    def observe(self, step: Step, known: Float, active: Bool) -> None:
        """Writes the last columns of the active copies' observations, which are complete else.

        Robots believe to be where they measured themselves: `known`, [E, >= 8 N], columns `ROBOT`
        first. Active copies are [E].
        """
        write_all_ways(
            known, step.layouts, step.times, active, self._guide, self._plans, step.observations
        )


def ways_definition(spec: TaskSpec) -> str:
    """How ways are found, for readers of a dataset."""
    radius = max(robot.radius for robot in spec.robots)
    factors = ", ".join(
        f"{factor} below {gap:g} m" for gap, factor in zip(GAP_LEVELS, GAP_WEIGHTS[1:], strict=True)
    )
    return (
        f"The map has a node every {NODE_SPACING:g} m from the arena's corner with the smallest x "
        "and y. The clearance of a node is its distance to the nearest obstacle or wall, at most "
        f"{radius + CLEARANCE_MARGIN:.9g} m; between nodes it is interpolated bilinearly. A line "
        f"keeps free of obstacles if the clearance on it is at least {radius + WAY_GAP:.9g} m, or "
        "that of its start or end minus 1 mm if that is less, in steps as long as what it has "
        f"beyond that, at least {NODE_SPACING / 2:g} m. If the line to the place is free, the way "
        f"is the line. Else paths lead over nodes that have more than {radius / 2:.9g} m of "
        "clearance and are not on the border, to their eight neighbors, from the node nearest to "
        f"the robot to that nearest to the place. Entering a node costs {STRAIGHT_COST}, "
        f"diagonally {DIAGONAL_COST}, times a factor of its gap, its clearance minus {radius:g} "
        f"m: {GAP_WEIGHTS[0]}, or {factors}. The way leads to the farthest of the second, fourth, "
        f"... node of the cheapest path, of its first {LOOKAHEAD_NODES}, before the first of them "
        "to which the line is not free; without any to the first node. Its length is that line "
        f"plus {NODE_SPACING / STRAIGHT_COST:g} m for each unit of the cost that is left. Where "
        "paths cost the same, the order of `swarmdata.numerics.distance_field` decides. Robot "
        "and place are where the robot believes them to be. Of a place with at most "
        f"{radius / 2:.9g} m of clearance all four numbers are 0. `nearer` counts senders whose "
        "newest message puts them nearer to the place than the robot is"
    )


def _way_features(name: str, place: str) -> tuple[Feature, ...]:
    toward = f"unit vector along the way to {place}, shrinking within 0.3 m of it"
    length = f"length of the way to {place} / diagonal of the arena, at most 1"
    nearer = f"share of the others that are nearer to {place}, by their newest messages"
    return (
        *vector(f"{name}_way", "direction", toward),
        Feature(f"{name}_way_length", "range", "", length),
        Feature(f"{name}_way_nearer", "range", "", nearer),
    )


def _senders(names: Sequence[str]) -> Int:
    """Columns of where each sender was and of its mask, [K, 2]; none without such messages."""
    column = {name: at for at, name in enumerate(names)}
    positions = [name for name in names if re.fullmatch(r"message_\d+\.position_x", name)]
    pairs = [(column[x], column[x.replace("position_x", "mask")]) for x in positions]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def paths_kept(n_agents: int) -> int:
    """How many paths are kept for each copy of a team of that size."""
    return 4 * n_agents + 8


def _no_plans(task: Task, n_copies: int) -> Plans:
    rows, columns = grid_shape(task.spec.arena, NODE_SPACING)
    n_obstacles, n_paths = len(task.kinds), paths_kept(task.spec.n_agents)
    shape = (n_copies, n_paths, rows * columns)
    return Plans(
        layouts=np.full((n_copies, n_obstacles, 8), np.nan, dtype=np.float32),
        clearances=np.zeros((n_copies, rows, columns), dtype=np.float32),
        ends=np.full((n_copies, n_paths), NO_NODE, dtype=np.int32),
        uses=np.zeros((n_copies, n_paths), dtype=np.int64),
        clocks=np.zeros(n_copies, dtype=np.int64),
        costs=np.zeros(shape, dtype=np.int32),
        next_nodes=np.zeros(shape, dtype=np.int32),
    )


@kernel
def map_layout(layout: Float, b: int, guide: Guide, plans: Plans) -> None:
    """Maps the obstacles of copy b, unless they are those of its map."""
    if (plans.layouts[b] == layout).all() and plans.clocks[b] > 0:
        return
    plans.layouts[b] = layout
    ground = Ground(plans.clearances[b], guide.half, NODE_SPACING)
    fill_clearances(layout, guide.radius + CLEARANCE_MARGIN, ground)
    plans.ends[b] = NO_NODE
    plans.clocks[b] = 1


@kernel
def paths_to(x: float, y: float, b: int, guide: Guide, plans: Plans) -> Paths:
    """Returns the paths of copy b to the node nearest to a point, kept for those used last."""
    ground = Ground(plans.clearances[b], guide.half, NODE_SPACING)
    rows, columns = ground.clearances.shape
    column = min(max(int((x + guide.half[0]) / NODE_SPACING + 0.5), 0), columns - 1)
    row = min(max(int((y + guide.half[1]) / NODE_SPACING + 0.5), 0), rows - 1)
    end, oldest = row * columns + column, 0
    plans.clocks[b] += 1
    for g in range(plans.ends.shape[1]):
        if plans.ends[b, g] == end:
            plans.uses[b, g] = plans.clocks[b]
            return Paths(plans.costs[b, g], plans.next_nodes[b, g])
        is_free = plans.ends[b, g] == NO_NODE
        if is_free or plans.uses[b, g] < plans.uses[b, oldest]:
            oldest = g
        if is_free:
            break
    plans.ends[b, oldest], plans.uses[b, oldest] = end, plans.clocks[b]
    paths = Paths(plans.costs[b, oldest], plans.next_nodes[b, oldest])
    to_x, to_y = position_of(end, ground)
    plan(to_x, to_y, guide.radius, ground, paths)
    return paths


@kernel
def find_way(
    x: float,  # where the robot is, m
    y: float,  # the same
    dx: float,  # the place relative to it, m
    dy: float,  # the same
    b: int,  # the copy
    guide: Guide,  # constants
    plans: Plans,  # of the copies
) -> tuple[float, float, float]:
    """Returns the point to aim at, relative to (x, y), and the length of the way, m."""
    ground, need = Ground(plans.clearances[b], guide.half, NODE_SPACING), guide.radius + WAY_GAP
    length = math.sqrt(dx * dx + dy * dy)
    if is_visible((x, y), (x + dx, y + dy), need, ground):
        return dx, dy, length
    paths = paths_to(x + dx, y + dy, b, guide, plans)
    node = farthest_visible_node((x, y), need, ground, paths)
    if node < 0:
        return dx, dy, length
    to_x, to_y = position_of(node, ground)
    to_x, to_y = to_x - x, to_y - y
    rest = paths.costs[node] * (NODE_SPACING / STRAIGHT_COST)
    return to_x, to_y, math.sqrt(to_x * to_x + to_y * to_y) + rest


@kernel
def write_way(
    way: tuple[float, float, float],  # from `find_way`
    heading: tuple[float, float],  # of the frame of the observation, a unit vector
    diagonal: float,  # of the arena, m
    out: Float,  # [>= 3] written
) -> None:
    """Writes direction and length of a way."""
    (x, y, length), (ux, uy) = way, heading
    distance = math.sqrt(x * x + y * y)
    scale = min(length / GOAL_NEAR, 1.0) / max(distance, 1e-9)
    out[0], out[1] = (ux * x + uy * y) * scale, (ux * y - uy * x) * scale
    out[2] = min(length / diagonal, 1.0)


@kernel
def share_nearer(x: float, y: float, row: Float, guide: Guide) -> float:
    """Returns the share of others nearer to a place at (x, y), m, in a robot's observation, [O].

    The place is relative to the robot, in the frame of the observation.
    """
    count = 0
    for k in range(guide.senders.shape[0]):
        at, mask = guide.senders[k]
        dx, dy = float(row[at]) - x, float(row[at + 1]) - y
        count += row[mask] > 0.0 and dx * dx + dy * dy < x * x + y * y
    return count / guide.n_others


@kernel
def write_all_ways(
    known: Float,  # [E, >= 8 N] the robots' measurements of themselves, columns `ROBOT` first
    layouts: Float,  # [E, M, 8]
    times: Int,  # [E] control steps since the reset
    active: Bool,  # [E] copies to write
    guide: Guide,  # constants
    plans: Plans,  # of the copies; changed
    observations: Float,  # [E, N, O] the last 4 P columns are written
) -> None:
    """Writes the ways of all robots of the active copies."""
    first = observations.shape[2] - N_WAY_FEATURES * guide.places.shape[0]
    for b in range(observations.shape[0]):
        if not active[b]:
            continue
        map_layout(layouts[b], b, guide, plans)
        ground = Ground(plans.clearances[b], guide.half, NODE_SPACING)
        shows_target = max(times[b] - guide.delay, 0) < guide.goal_steps
        for i in range(observations.shape[1]):
            robot, row = known[b, N_COLUMNS * i : N_COLUMNS * (i + 1)], observations[b, i]
            x, y, ux, uy = float(robot[X]), float(robot[Y]), 1.0, 0.0
            if guide.in_body:
                ux, uy = float(robot[UX]), float(robot[UY])
            for p in range(guide.places.shape[0]):
                k, at = guide.places[p], first + N_WAY_FEATURES * p
                if k == OWN_TARGET:
                    dx, dy = float(robot[TX]) - x, float(robot[TY]) - y
                    vx, vy = ux * dx + uy * dy, ux * dy - uy * dx
                    is_told = shows_target
                else:
                    vx, vy = float(row[k]), float(row[k + 1])
                    dx, dy = ux * vx - uy * vy, uy * vx + ux * vy
                    is_told = vx != 0.0 or vy != 0.0
                row[at : at + N_WAY_FEATURES] = 0.0
                if is_told and free_distance(x + dx, y + dy, ground) > 0.5 * guide.radius:
                    way = find_way(x, y, dx, dy, b, guide, plans)
                    write_way(way, (ux, uy), guide.diagonal, row[at : at + N_WAY_FEATURES])
                    row[at + 3] = share_nearer(vx, vy, row, guide)
