"""Random layouts, starts and goals: solvable by construction, a pure function of the episode seed.

Gaps around bounding circles are wide enough for a robot, and concave shapes open into them.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, bounding_radius, clearance
from swarmdata.numerics.random import GOLDEN_GAMMA, MIX_1, MIX_2, STREAMS
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds

OBSTACLE_COUNTS = ("circles", "boxes", "corners", "pockets")  # of `task_spec.Obstacles`
PLACE_TRIES = 64  # attempts to place one obstacle or robot before the whole layout is drawn again

LAYOUT_OFFSET = (STREAMS["layout"] + 1) * GOLDEN_GAMMA % 2**64
"""Added to an episode's seed, it gives the initial state of the layout's random generator."""

SizeTable = Double  # per obstacle: kind, smallest and largest half length, half thickness, [M, 4]


class Spacing(NamedTuple):
    """Distances that drawn points keep, m."""

    clearance: float  # between a robot's surface and obstacles or walls
    separation: float  # between the surfaces of two robots


class SpawnPlan(NamedTuple):
    """Everything in a spec that random layouts depend on."""

    sizes: SizeTable  # obstacles to draw, [M, 4]
    half: Double  # half width and half height of the arena, m, [2]
    radii: Double  # m, [N]
    has_heading: Bool  # whether a robot's heading is drawn, [N]
    obstacle_gap: float  # m
    starts: Spacing
    goals: Spacing
    min_goal_distance: float  # from a robot's start, m
    max_attempts: int  # whole layouts to try before giving up

    @classmethod
    def of(cls, spec: TaskSpec) -> "SpawnPlan":
        s, robots = spec.spawn, spec.robots
        return cls(
            sizes=size_table(spec),
            half=np.array(spec.half_size),
            radii=np.array([robot.radius for robot in robots]),
            has_heading=np.array([robot.dynamics == "unicycle" for robot in robots]),
            obstacle_gap=spec.obstacles.gap,
            starts=Spacing(s.start_clearance, s.start_separation),
            goals=Spacing(s.goal_clearance, s.goal_separation),
            min_goal_distance=s.min_goal_distance,
            max_attempts=s.max_attempts,
        )

    @property
    def kinds(self) -> Int:
        """Shape code of each obstacle, [M]."""
        return self.sizes[:, 0].astype(np.int64)


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
    """Raises a `SpecError` if a spec asks for random obstacles where the layout is fixed."""
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


@kernel(inline="always")
def unit_vector(t: float) -> tuple[float, float]:
    """A rational point of the unit circle: cosine and sine of twice the angle of tangent t."""
    return (1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t)


@kernel(inline="always")
def direction_of(u: float, v: float) -> tuple[float, float]:
    """Turns two uniform numbers in [0, 1) into a unit vector."""
    x, y = unit_vector(2.0 * u - 1.0)
    return (x, y) if v < 0.5 else (-x, -y)


@kernel
def _shape(state: Seeds, size: Double, row: Float) -> None:
    """Draws the size and the orientation of an obstacle."""
    low, high = size[1], size[2]
    row[0] = size[0]
    row[5] = low + (high - low) * next_uniform(state)
    row[6] = row[5] if size[0] == CIRCLE else low + (high - low) * next_uniform(state)
    row[7] = size[3]
    row[3], row[4] = direction_of(next_uniform(state), next_uniform(state))


@kernel
def place_obstacles(
    state: Seeds, sizes: SizeTable, half: Double, gap: float, layout: Float
) -> bool:
    """Draws all obstacles; returns False if one of them found no place."""
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
            if is_apart(row, layout, m, gap):
                break
    return True


@kernel
def is_apart(row: Float, layout: Float, m: int, gap: float) -> bool:
    """Whether an obstacle's bounding circle keeps a gap from those of the layout's first m."""
    r = bounding_radius(row)
    for k in range(m):
        dx, dy = float(layout[k, 1]) - float(row[1]), float(layout[k, 2]) - float(row[2])
        need = r + bounding_radius(layout[k]) + gap
        if dx * dx + dy * dy < need * need:
            return False
    return True


@kernel
def place_points(
    state: Seeds,  # [1] of the generator
    layout: Float,  # [M, 8]
    half: Double,  # [2] half width and half height of the arena, m
    radii: Double,  # [N] m
    spacing: Spacing,  # distances to keep
    points: Float,  # [N, 2] written
    far: Float,  # [N, 2] the point that each robot's must stay away from
    min_distance: float,  # distance to that point, m
) -> bool:
    """Draws one point per robot, clear of obstacles and of each other, and away from `far`.

    Returns:
        Whether every robot found a place.
    """
    for i in range(radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            points[i, 0] = (half[0] - radii[i]) * (2.0 * next_uniform(state) - 1.0)
            points[i, 1] = (half[1] - radii[i]) * (2.0 * next_uniform(state) - 1.0)
            x, y = float(points[i, 0]), float(points[i, 1])
            dx, dy = float(far[i, 0]) - x, float(far[i, 1]) - y
            is_far = dx * dx + dy * dy >= min_distance * min_distance
            if is_far and is_free_place(points, i, radii, spacing, layout, half):
                break
    return True


@kernel
def is_free_place(
    points: Float, i: int, radii: Double, spacing: Spacing, layout: Float, half: Double
) -> bool:
    """Whether robot i's point keeps its distances from obstacles, walls and earlier points."""
    x, y = float(points[i, 0]), float(points[i, 1])
    for j in range(i):
        dx, dy = float(points[j, 0]) - x, float(points[j, 1]) - y
        need = radii[i] + radii[j] + spacing.separation
        if dx * dx + dy * dy < need * need:
            return False
    return bool(clearance(x, y, layout, half) >= radii[i] + spacing.clearance)


@kernel
def place_all(
    state: Seeds,  # [1] of the generator
    plan: SpawnPlan,  # of the spec
    layout: Float,  # [M, 8] written
    starts: Float,  # [N, 2] of the robots, written
    goal_radii: Double,  # [K] room that each goal needs, m
    goals: Float,  # [K, 2] written
    far: Float,  # [K, 2] the point that each goal must stay away from
    min_distance: float,  # distance to that point, m
) -> bool:
    """Draws obstacles, starts and goals together; returns False if no attempt placed all."""
    for _ in range(plan.max_attempts):
        if not place_obstacles(state, plan.sizes, plan.half, plan.obstacle_gap, layout):
            continue
        if not place_points(state, layout, plan.half, plan.radii, plan.starts, starts, starts, 0.0):
            continue
        if place_points(state, layout, plan.half, goal_radii, plan.goals, goals, far, min_distance):
            return True
    return False


@kernel
def draw_heading(state: Seeds, robot: Float) -> None:
    """Draws a heading into the columns UX and UY of a robot, [8]."""
    robot[UX], robot[UY] = direction_of(next_uniform(state), next_uniform(state))


@kernel
def put_at_rest(state: Seeds, has_heading: bool, robot: Float) -> None:
    """Sets a robot's velocity to zero, and draws its heading or sets it to +x; columns of [8]."""
    robot[VX] = robot[VY] = robot[UY] = 0.0
    robot[UX] = 1.0
    if has_heading:
        draw_heading(state, robot)


@kernel
def _spawn(seeds: Seeds, copies: Int, plan: SpawnPlan, layouts: Float, robots: Float) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    state = np.empty(1, np.uint64)
    for k in range(copies.shape[0]):
        b = copies[k]
        layout, starts, goals = layouts[b], robots[b, :, X : Y + 1], robots[b, :, TX : TY + 1]
        state[0] = seeds[k] + np.uint64(LAYOUT_OFFSET)
        if not place_all(
            state, plan, layout, starts, plan.radii, goals, starts, plan.min_goal_distance
        ):
            return k
        for i in range(plan.radii.shape[0]):
            put_at_rest(state, plan.has_heading[i], robots[b, i])
    return copies.shape[0]


def spawn_random(
    spec: TaskSpec, plan: SpawnPlan, seeds: Seeds, copies: Int, layouts: Float, robots: Float
) -> None:
    """Draws obstacles, starts, headings and targets of the episodes `seeds` [C].

    They are written to the rows `copies` of `layouts` [E, M, 8] and `robots` [E, N, 8].

    Raises:
        SpawnError: no layout was found in `spawn.max_attempts` attempts, though one may exist.
    """
    drawn = _spawn(seeds, copies, plan, layouts, robots)
    if drawn < len(copies):
        raise SpawnError(
            f"no layout found for seed {seeds[drawn]} in {plan.max_attempts} attempts: robots and "
            f"obstacles with their gaps cover {density(spec):.0%} of the arena (about 50% is "
            "the limit). Use fewer or smaller obstacles."
        )


def density(spec: TaskSpec) -> float:
    """Share of the arena that robots and bounding circles of obstacles cover, gaps included."""
    sizes = size_table(spec)
    longest = sizes[:, 2]
    reach = (
        np.where(sizes[:, 0] == CIRCLE, longest, longest * math.sqrt(2)) + spec.obstacles.gap / 2
    )
    robots = sum((robot.radius + spec.spawn.start_separation / 2) ** 2 for robot in spec.robots)
    return math.pi * (float((reach**2).sum()) + robots) / (spec.arena.width * spec.arena.height)
