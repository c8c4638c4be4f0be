"""The `state` model: low-dimensional features in the world's frame, for robots that localise."""

import math
from typing import Annotated, NamedTuple

import numpy as np

from swarmdata.numerics.geometry import bounding_radius, nearest_of, nearest_of_shape
from swarmdata.perception.sensing.measured_world import Sense, World
from swarmdata.perception.sensing.modifiers import NO_ECHOES
from swarmdata.perception.sensing.sensed_scene import Scene
from swarmdata.runtime.argument_blocks import ArgumentBlock, bundle_type, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, numbered, telling_goals, vector
from swarmdata.specs.sensing_models import StateModel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, VX, VY, X, Y
from swarmdata.types import Bool, Double, Float, Int

_TO_TARGET = "target minus own position"
_TARGET_DIRECTION = "unit vector to the target, shrinking within 0.3 m of it"
_NEAR_MEANING = (
    "direction to the nearest surface point, either one of two, times closeness: 0 at the range, "
    "1 in contact"
)

OWN_FEATURES = (
    Feature("own.x", "position", "x", "own position"),
    Feature("own.y", "position", "y", "own position"),
    Feature("own.vx", "velocity", "x", "own velocity"),
    Feature("own.vy", "velocity", "y", "own velocity"),
    *telling_goals(
        (
            Feature("own.goal_dx", "position", "x", _TO_TARGET),
            Feature("own.goal_dy", "position", "y", _TO_TARGET),
            Feature("own.goal_ux", "direction", "x", _TARGET_DIRECTION),
            Feature("own.goal_uy", "direction", "y", _TARGET_DIRECTION),
        )
    ),
)

PLACE_FEATURES = OWN_FEATURES[:2]  # those that the body's frame has not

HEADING_FEATURES = vector("own.heading", "direction", "own heading")
"""Follows `OWN_FEATURES` in teams with a unicycle; (1, 0) in the body's frame."""

NEIGHBOR_FEATURES = (
    Feature("dx", "position", "x", "position relative to the own"),
    Feature("dy", "position", "y", "position relative to the own"),
    Feature("dvx", "velocity", "x", "velocity relative to the own"),
    Feature("dvy", "velocity", "y", "velocity relative to the own"),
    *vector("near", "direction", "direction to it times closeness: 0 at the range, 1 in contact"),
    Feature("mask", "flag", meaning="1 if the slot holds a robot; nearest first"),
)

OBSTACLE_FEATURES = (
    *vector("near", "direction", _NEAR_MEANING),
    Feature("dx", "position", "x", "center relative to the own position"),
    Feature("dy", "position", "y", "center relative to the own position"),
    *vector("axis", "position", "local x axis times the bounding radius"),
    Feature("kind", "flag", meaning="shape: 0 circle, 1/3 box, 2/3 corner, 1 pocket"),
    Feature("mask", "flag", meaning="1 if the slot holds an obstacle; nearest first"),
)

GOAL_NEAR = 0.3  # distance (m) below which the goal direction shrinks linearly to zero

_FIRST_TEST_SLACK = 1e-4
"""Share, and metres, by which a first, cheap test is too wide, so that it keeps all that count."""

_OWN, _NEIGHBOR, _OBSTACLE = len(OWN_FEATURES), len(NEIGHBOR_FEATURES), len(OBSTACLE_FEATURES)


class StateConstants(NamedTuple):
    """What `observe_states` needs besides the world."""

    radii: Annotated[Double, 1]  # [N] m
    limits: Annotated[Double, 1]  # [N] m, gaps beyond which each robot sees nothing
    n_own: int  # features of the own block
    n_neighbors: int  # slots
    n_obstacles: int  # slots
    reach: float  # m, the gap at which closeness features reach 0


STATE_CONSTANTS = bundle_type(StateConstants)


def state_sense(model: StateModel, scene: Scene) -> Sense:
    """Self, nearest robots and nearest obstacles, in the world's frame, as measured.

    Features: `OWN_FEATURES`, `HEADING_FEATURES` in teams with a unicycle, then the slots of
    `NEIGHBOR_FEATURES` and of `OBSTACLE_FEATURES`, nearest surface first. A slot without an object
    is zero.
    """
    own = OWN_FEATURES + (HEADING_FEATURES if scene.has_headings else ())
    near = numbered("neighbor", model.n_neighbors, NEIGHBOR_FEATURES)
    around = numbered("obstacle", model.n_obstacles, OBSTACLE_FEATURES)
    constants = StateConstants(
        radii=scene.radii,
        limits=np.minimum(scene.ranges, np.inf if model.limit is None else model.limit),
        n_own=len(own),
        n_neighbors=model.n_neighbors,
        n_obstacles=model.n_obstacles,
        reach=model.range,
    )
    block = ArgumentBlock(constants, STATE_CONSTANTS)

    def sense(world: World, robots: range, active: Bool, out: Float) -> None:
        observe_states(
            block.packed, world.states, world.layouts, robots.start, robots.stop, active, out
        )

    return Sense(own + near + around, NO_ECHOES, sense)


@kernel(inline="always")
def _insert(found: Double, k: int, gap: float, index: int, vx: float, vy: float) -> None:
    """Keeps the k smallest gaps in order, as rows (gap, index, vx, vy); ties by their index."""
    slot = k
    while slot > 0 and (
        gap < found[slot - 1, 0] or (gap == found[slot - 1, 0] and index < found[slot - 1, 1])
    ):
        slot -= 1
        if slot + 1 < k:
            for c in range(4):
                found[slot + 1, c] = found[slot, c]
    if slot < k:
        found[slot, 0] = gap
        found[slot, 1] = index
        found[slot, 2] = vx
        found[slot, 3] = vy


@kernel(inline="always")
def _closeness(gap: float, reach: float) -> float:
    """1 at contact, falling linearly to 0 at a gap of `reach`."""
    return min(max(1.0 - gap / reach, 0.0), 1.0)


@kernel(error_model="numpy")
def _own(out: Float, state: Float, at: int, n_own: int) -> None:
    """Fills the own features, heading included if there is room, of the robot at column `at`."""
    gx = float(state[at + TX]) - float(state[at + X])
    gy = float(state[at + TY]) - float(state[at + Y])
    scale = 1.0 / max(math.sqrt(gx * gx + gy * gy), GOAL_NEAR)
    for c in range(4):
        out[c] = state[at + c]
    out[4] = gx
    out[5] = gy
    out[6] = gx * scale
    out[7] = gy * scale
    for c in range(n_own - _OWN):
        out[_OWN + c] = state[at + UX + c]


@kernel(error_model="numpy")
def _neighbors(
    out: Float,  # [O] written
    first: int,  # column of the first slot
    state: Float,  # [S]
    i: int,  # the robot
    radii: Double,  # [N] m
    k: int,  # slots
    reach: float,  # gap (m) at which closeness is 0
    limit: float,  # gap (m) beyond which robots are not seen
    gaps: Double,  # [N] scratch
    keys: Int,  # [N] scratch, the same memory as the gaps
) -> None:
    """Fills the neighbour slots of robot i, nearest first."""
    n, at, own = radii.shape[0], N_COLUMNS * i, radii[i]
    px, py = state[at + X], state[at + Y]
    for j in range(n):
        dx, dy = state[N_COLUMNS * j + X] - px, state[N_COLUMNS * j + Y] - py
        gap = math.sqrt(dx * dx + dy * dy) - own - radii[j]
        gaps[j] = gap if gap <= limit else np.inf
    gaps[i] = np.inf
    order_keys(keys)
    for slot in range(k):
        o = first + _NEIGHBOR * slot
        j = take_smallest(keys) if slot < n else i
        ddx, ddy = state[N_COLUMNS * j + X] - px, state[N_COLUMNS * j + Y] - py
        gap = math.sqrt(ddx * ddx + ddy * ddy) - own - radii[j]
        if j == i or not gap <= limit:  # NaN: missed
            for c in range(_NEIGHBOR):
                out[o + c] = 0.0
            continue
        x, y = np.float64(ddx), np.float64(ddy)
        close = _closeness(gap, reach) / max(math.sqrt(x * x + y * y), 1e-9)
        out[o] = x
        out[o + 1] = y
        out[o + 2] = state[N_COLUMNS * j + VX] - state[at + VX]
        out[o + 3] = state[N_COLUMNS * j + VY] - state[at + VY]
        out[o + 4] = x * close
        out[o + 5] = y * close
        out[o + 6] = 1.0


@kernel(error_model="numpy")
def _find_obstacles(
    px: float,  # of the robot, m
    py: float,  # of the robot, m
    radius: float,  # of the robot, m
    layout: Float,  # [M, 8]
    circles: Double,  # [3, M] centres and bounding radii, m
    k: int,  # slots
    limit: float,  # gap (m) beyond which obstacles are not seen
    found: Double,  # [k, 4] written, as by `_insert`
    squares: Double,  # [M] scratch
    powers: Double,  # [M] scratch
    keys: Int,  # [M] scratch, the same memory as the powers
) -> None:
    """Finds the k nearest surfaces: likely ones first, then the few that may be nearer yet."""
    n = squares.shape[0]
    for m in range(n):
        dx, dy, size = circles[0, m] - px, circles[1, m] - py, circles[2, m]
        square = dx * dx + dy * dy
        squares[m] = square if square < np.inf else np.inf  # NaN: missed
        powers[m] = squares[m] - size * size
    order_keys(keys)
    for slot in range(k):
        found[slot, 0] = np.inf
        found[slot, 1] = -1.0
    for _ in range(min(k, n)):
        m = take_smallest(keys)
        squares[m] = np.inf
        distance, vx, vy = nearest_of(px, py, layout, m)
        if distance - radius <= limit:
            _insert(found, k, distance - radius, m, vx, vy)
    bound = (min(found[k - 1, 0], limit) + radius) * (1.0 + _FIRST_TEST_SLACK) + _FIRST_TEST_SLACK
    n_nearer = 0
    for m in range(n):
        reach = bound + circles[2, m]
        n_nearer += 1 if squares[m] < reach * reach else 0
    for m in range(n if n_nearer > 0 else 0):
        reach = bound + circles[2, m]
        if squares[m] < reach * reach:
            distance, vx, vy = nearest_of(px, py, layout, m)
            if distance - radius <= limit:
                _insert(found, k, distance - radius, m, vx, vy)


@kernel(error_model="numpy")
def _scan_obstacles(
    px: float,
    py: float,
    radius: float,
    layout: Float,
    circles: Double,
    k: int,
    limit: float,
    found: Double,
) -> None:
    """Does what `_find_obstacles` does, in the order of the layout: faster where k of few count."""
    for slot in range(k):
        found[slot, 0] = np.inf
        found[slot, 1] = -1.0
    bound = np.inf
    for m in range(layout.shape[0]):
        dx, dy, reach = circles[0, m] - px, circles[1, m] - py, bound + circles[2, m]
        if not dx * dx + dy * dy < reach * reach:  # NaN: missed
            continue
        distance, vx, vy = nearest_of_shape(  # in line, which is faster here than `nearest_of`
            px, py, layout[m, 0], layout[m, 1], layout[m, 2], layout[m, 3], layout[m, 4],
            layout[m, 5], layout[m, 6], layout[m, 7],
        )  # fmt: skip
        gap, slot = distance - radius, k - 1
        if gap <= limit and gap < found[slot, 0]:
            while slot > 0 and gap < found[slot - 1, 0]:
                for c in range(4):
                    found[slot, c] = found[slot - 1, c]
                slot -= 1
            found[slot, 0], found[slot, 1], found[slot, 2], found[slot, 3] = gap, m, vx, vy
            bound = (min(found[k - 1, 0], limit) + radius) * (1.0 + _FIRST_TEST_SLACK)
            bound += _FIRST_TEST_SLACK


@kernel(error_model="numpy")
def _obstacles(
    out: Float, first: int, px: float, py: float, layout: Float, circles: Double, radius: float,
    k: int, reach: float, found: Double,
) -> None:  # fmt: skip
    """Fills the obstacle slots of a robot at (px, py) from the rows of `_find_obstacles`."""
    for slot in range(k):
        o = first + _OBSTACLE * slot
        gap, vx, vy = found[slot, 0], found[slot, 2], found[slot, 3]
        m = int(found[slot, 1])
        if m < 0:
            for c in range(_OBSTACLE):
                out[o + c] = 0.0
            continue
        close = _closeness(gap, reach) / max(gap + radius, 1e-9)
        out[o] = vx * close
        out[o + 1] = vy * close
        out[o + 2] = layout[m, 1] - px
        out[o + 3] = layout[m, 2] - py
        out[o + 4] = layout[m, 3] * circles[2, m]
        out[o + 5] = layout[m, 4] * circles[2, m]
        out[o + 6] = float(layout[m, 0]) / 3.0
        out[o + 7] = 1.0


@kernel(error_model="numpy")
def observe_states(
    packed: Int,  # `StateConstants`, of an `ArgumentBlock`
    states: Float,  # [E, S]; a robot that was missed is at NaN
    layouts: Float,  # obstacles, [E, M, 8]; the same
    first_robot: int,  # that observes
    end_robot: int,  # one past the last
    active: Bool,  # copies to observe, [E]; rows of the others are not written
    observations: Float,  # [E, N, O] written
) -> None:
    """Writes the `state` observation of some robots in every active copy."""
    radii, limits, n_own, n_neighbors, n_obstacles, reach = unpack(packed, STATE_CONSTANTS)
    n_agents, n_shapes = radii.shape[0], layouts.shape[1]
    found, circles = np.empty((n_obstacles, 4)), np.empty((3, n_shapes))
    gaps, squares, powers = np.empty(n_agents), np.empty(n_shapes), np.empty(n_shapes)
    gap_keys, power_keys = gaps.view(np.int64), powers.view(np.int64)
    first = n_own + _NEIGHBOR * n_neighbors
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        layout, state = layouts[b], states[b]
        for m in range(n_shapes):
            circles[0, m] = layout[m, 1]
            circles[1, m] = layout[m, 2]
            circles[2, m] = bounding_radius(layout[m])
        for i in range(first_robot, end_robot):
            out, at = observations[b, i], N_COLUMNS * i
            px, py, radius = state[at + X], state[at + Y], radii[i]
            _own(out, state, at, n_own)
            if n_neighbors > 0:
                _neighbors(
                    out, n_own, state, i, radii, n_neighbors, reach, limits[i], gaps, gap_keys
                )
            if n_obstacles > 0:
                if n_shapes <= 2 * n_obstacles:
                    _scan_obstacles(px, py, radius, layout, circles, n_obstacles, limits[i], found)
                else:
                    _find_obstacles(
                        px, py, radius, layout, circles, n_obstacles, limits[i], found, squares,
                        powers, power_keys,
                    )  # fmt: skip
                _obstacles(out, first, px, py, layout, circles, radius, n_obstacles, reach, found)


TAKEN_KEY = np.int64(np.iinfo(np.int64).max)
"""Key of a number that was taken: above that of any number."""


@kernel(inline="always")
def order_keys(keys: Int) -> None:
    """Turns the bits of float64 numbers, none NaN or -0, into integers of the same order, in place.

    The bits of positive floats are in the order of the floats, those of negative ones in reverse.
    """
    for m in range(keys.shape[0]):
        keys[m] ^= (keys[m] >> 63) & TAKEN_KEY


@kernel(inline="always")
def take_smallest(keys: Int) -> int:
    """Index of the smallest key, the first of equal ones; its key becomes `TAKEN`."""
    best = TAKEN_KEY
    for m in range(keys.shape[0]):
        best = min(best, keys[m])
    index = 0
    while keys[index] != best:
        index += 1
    keys[index] = TAKEN_KEY
    return index
