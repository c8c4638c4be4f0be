"""Random layouts, starts and goals: solvable by construction, a pure function of the episode seed.

Bounding circles of obstacles keep a gap from each other and from the walls in which a robot fits,
and every concave shape opens into free space, so the free space is connected: any start reaches any
goal. The random numbers are SplitMix64's, as in `seeding`.
"""

import math
from dataclasses import dataclass

import numpy as np

from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, bounding_radius, clearance
from swarmdata.numerics.random import GOLDEN_GAMMA, MIX_1, MIX_2, STREAMS
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds

OBSTACLE_COUNTS = ("circles", "boxes", "corners", "pockets")
"""Fields of `spec.Obstacles` that count obstacles."""

PLACE_TRIES = 64
"""Draws of one place before the whole layout is drawn anew."""

LAYOUT_OFFSET = (STREAMS["layout"] + 1) * GOLDEN_GAMMA % 2**64
"""What is added to an episode's seed to start the generator of its layout."""

SizeTable = Double
"""One row per obstacle: kind, smallest and largest half length, half thickness, [M, 4]."""


def size_table(spec: TaskSpec) -> SizeTable:
    """Lists the obstacles to draw, largest shapes first, as [M, 4]."""
    o, t = spec.obstacles, spec.obstacles.bar_half_thickness
    rows = (
        [(POCKET, *o.pocket_half_length, t)] * o.pockets
        + [(CORNER, *o.corner_half_length, t)] * o.corners
        + [(BOX, *o.box_half_length, 0.0)] * o.boxes
        + [(CIRCLE, *o.circle_radius, 0.0)] * o.circles
    )
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def check_fixed_layout(spec: TaskSpec, what: str) -> None:
    """Refuses drawn obstacles where the layout is fixed; nothing in a spec is ever ignored.

    Raises:
        SpecError: the spec asks for obstacles.
    """
    counts = {name: getattr(spec.obstacles, name) for name in OBSTACLE_COUNTS}
    if any(counts.values()):
        raise SpecError(
            f"obstacles are {counts} in a spec with {what}, whose layout is fixed. Write "
            f"obstacles: {{{', '.join(f'{name}: 0' for name in OBSTACLE_COUNTS)}}}."
        )


@kernel(inline="always")
def next_uniform(state: Seeds) -> float:
    """Advances the generator; returns a multiple of 2**-53 in [0, 1)."""
    state[0] += np.uint64(GOLDEN_GAMMA)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(MIX_1)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(MIX_2)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53


@kernel
def _shape(state: Seeds, size: Double, row: Float) -> None:
    """Draws shape and orientation; the direction is a rational point of the unit circle."""
    low, high = size[1], size[2]
    row[0] = size[0]
    row[5] = low + (high - low) * next_uniform(state)
    row[6] = row[5] if size[0] == CIRCLE else low + (high - low) * next_uniform(state)
    row[7] = size[3]
    t = 2.0 * next_uniform(state) - 1.0
    sign = 1.0 if next_uniform(state) < 0.5 else -1.0
    row[3] = sign * (1.0 - t * t) / (1.0 + t * t)
    row[4] = sign * 2.0 * t / (1.0 + t * t)


@kernel
def place_obstacles(
    state: Seeds, sizes: SizeTable, half: Double, gap: float, layout: Float
) -> bool:
    """Draws all obstacles; False if one of them found no place."""
    for m in range(sizes.shape[0]):
        row = layout[m]
        _shape(state, sizes[m], row)
        r = bounding_radius(row)
        room_x, room_y = half[0] - r - gap, half[1] - r - gap
        if room_x <= 0.0 or room_y <= 0.0:
            return False
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            row[1] = room_x * (2.0 * next_uniform(state) - 1.0)
            row[2] = room_y * (2.0 * next_uniform(state) - 1.0)
            if _is_free(row, r, layout, m, gap):
                break
    return True


@kernel
def _is_free(row: Float, r: float, layout: Float, m: int, gap: float) -> bool:
    for k in range(m):
        dx, dy = float(layout[k, 1]) - float(row[1]), float(layout[k, 2]) - float(row[2])
        need = r + bounding_radius(layout[k]) + gap
        if dx * dx + dy * dy < need * need:
            return False
    return True


@kernel
def place_points(
    state: Seeds,
    layout: Float,
    half: Double,
    radii: Double,
    margins: Double,
    points: Float,
    far: Float,
    min_distance: float,
) -> bool:
    """Draws one point per robot, clear of obstacles and each other and away from `far`.

    Args:
        state: of the generator, [1].
        layout: [M, 8].
        half: half width and half height of the arena, m, [2].
        radii: m, [N].
        margins: clearance and separation between surfaces, m, [2].
        points: written, [N, 2].
        far: points to stay away from, [N, 2].
        min_distance: m.

    Returns:
        False if a robot found no place.
    """
    for i in range(radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            points[i, 0] = (half[0] - radii[i]) * (2.0 * next_uniform(state) - 1.0)
            points[i, 1] = (half[1] - radii[i]) * (2.0 * next_uniform(state) - 1.0)
            x, y = float(points[i, 0]), float(points[i, 1])
            dx, dy = float(far[i, 0]) - x, float(far[i, 1]) - y
            free = dx * dx + dy * dy >= min_distance * min_distance
            for j in range(i):
                dx, dy = float(points[j, 0]) - x, float(points[j, 1]) - y
                need = radii[i] + radii[j] + margins[1]
                free = free and dx * dx + dy * dy >= need * need
            if free and clearance(x, y, layout, half) >= radii[i] + margins[0]:
                break
    return True


@kernel
def draw_heading(state: Seeds, robot: Float) -> None:
    """Draws a heading, a rational point of the unit circle as in `_shape`, into columns UX, UY."""
    t = 2.0 * next_uniform(state) - 1.0
    sign = 1.0 if next_uniform(state) < 0.5 else -1.0
    robot[UX] = sign * (1.0 - t * t) / (1.0 + t * t)
    robot[UY] = sign * 2.0 * t / (1.0 + t * t)


@kernel
def _spawn(
    seeds: Seeds,
    copies: Int,
    sizes: SizeTable,
    half: Double,
    team: tuple[Double, Bool],
    margins: Double,
    max_attempts: int,
    layouts: Float,
    robots: Float,
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed.

    Args:
        seeds: episode seeds, [len(copies)].
        copies: rows to write.
        sizes: obstacles to draw, from `size_table`, [M, 4].
        half: half width and half height of the arena, m, [2].
        team: radii, m, and whether a heading is drawn, each [N].
        margins: gap between obstacles; clearance and separation of starts; clearance and separation
            of goals; smallest distance from start to goal; all m, [6].
        max_attempts: whole layouts to try before giving up.
        layouts: written, [E, M, 8].
        robots: written, columns `states.ROBOT`, [E, N, 8].
    """
    radii, turns = team
    state = np.empty(1, np.uint64)
    for k in range(copies.shape[0]):
        b = copies[k]
        starts, goals = robots[b, :, X : Y + 1], robots[b, :, TX : TY + 1]
        state[0] = seeds[k] + np.uint64(LAYOUT_OFFSET)
        for attempt in range(max_attempts + 1):
            if attempt == max_attempts:
                return k
            if not place_obstacles(state, sizes, half, margins[0], layouts[b]):
                continue
            if not place_points(state, layouts[b], half, radii, margins[1:3], starts, starts, 0.0):
                continue
            if place_points(
                state, layouts[b], half, radii, margins[3:5], goals, starts, margins[5]
            ):
                break
        for i in range(radii.shape[0]):
            robots[b, i, VX] = robots[b, i, VY] = robots[b, i, UY] = 0.0
            robots[b, i, UX] = 1.0
            if turns[i]:
                draw_heading(state, robots[b, i])
    return copies.shape[0]


@dataclass(frozen=True, eq=False)
class SpawnPlan:
    """What random layouts need to know of a spec."""

    spec: TaskSpec
    sizes: SizeTable  # [M, 4]
    half: Double  # half width and half height of the arena, m, [2]
    team: tuple[Double, Bool]  # radii, m, and whether a heading is drawn, each [N]
    margins: Double  # [6]

    @classmethod
    def of(cls, spec: TaskSpec) -> "SpawnPlan":
        """Collects it."""
        s, robots = spec.spawn, spec.robots
        margins = (
            spec.obstacles.gap,
            s.start_clearance,
            s.start_separation,
            s.goal_clearance,
            s.goal_separation,
            s.min_goal_distance,
        )
        return cls(
            spec=spec,
            sizes=size_table(spec),
            half=np.array([spec.arena.width / 2, spec.arena.height / 2]),
            team=(
                np.array([robot.radius for robot in robots]),
                np.array([robot.dynamics == "unicycle" for robot in robots]),
            ),
            margins=np.array(margins),
        )

    @property
    def kinds(self) -> Int:
        """Shape code of each obstacle, [M]."""
        return self.sizes[:, 0].astype(np.int64)


def spawn_random(plan: SpawnPlan, seeds: Seeds, copies: Int, layouts: Float, robots: Float) -> None:
    """Draws obstacles, starts, headings and targets of the episodes `seeds`.

    Args:
        plan: from the spec.
        seeds: one for each copy to write.
        copies: rows to write.
        layouts: written, [E, M, 8].
        robots: written, columns `states.ROBOT`, [E, N, 8].

    Raises:
        SpawnError: no layout was found; nothing says that there is none.
    """
    attempts = plan.spec.spawn.max_attempts
    drawn = _spawn(
        seeds, copies, plan.sizes, plan.half, plan.team, plan.margins, attempts, layouts, robots
    )
    if drawn < len(copies):
        raise SpawnError(
            f"no layout found for seed {seeds[drawn]} in {attempts} attempts: robots and "
            f"obstacles with their gaps cover {density(plan.spec):.0%} of the arena (about 50% is "
            "the limit). Use fewer or smaller obstacles."
        )


def density(spec: TaskSpec) -> float:
    """Part of the arena that robots and bounding circles of obstacles cover, with their gaps."""
    sizes = size_table(spec)
    longest = sizes[:, 2]
    reach = (
        np.where(sizes[:, 0] == CIRCLE, longest, longest * math.sqrt(2)) + spec.obstacles.gap / 2
    )
    robots = sum((robot.radius + spec.spawn.start_separation / 2) ** 2 for robot in spec.robots)
    return math.pi * (float((reach**2).sum()) + robots) / (spec.arena.width * spec.arena.height)
