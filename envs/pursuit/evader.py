"""How an evader moves: it wanders until a pursuer comes near, and then flees by looking ahead.

An evader sees pursuers within its sight range that no obstacle hides. It is alarmed while one of
them is near: from `ALARM_DISTANCE` on, until all are beyond `CALM_DISTANCE`.

While calm, it walks at `WANDER_SPEED` along a heading that turns at random, and turns away,
standing still, where it comes near something solid. While alarmed, it moves at its speed along the
best of `N_HEADINGS` headings. For each it imagines `lookahead` seconds in which the pursuers that
it sees drive straight at it. A heading on which one of them comes within the capture radius and a
margin is the better the later that is; any other is better than these, by

    distance to the nearest pursuer at the end + 0.25 min(clearance, 0.6 m) - 0.3 (distance from the
    middle of the arena, 1 at a wall)

It slides along what is in its way, keeps out of obstacles and walls and, where its speed allows it,
of robots.

`EVADERS` are variants of this rule, as opponents that a team has not met.

Float64 `+ - * /`, `sqrt` and tables only, so that the bits are the same on every platform.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np

from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.numerics.geometry import CIRCLE, clearance, nearest_of
from swarmdata.numerics.random import STREAMS, normal_table
from swarmdata.numerics.random_kernels import absorb, to_normal
from swarmdata.numerics.sight import is_in_sight
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

N_HEADINGS = 32  # directions in which an evader can flee
N_ROLL_STEPS = 8  # steps in which it imagines the pursuit ahead
ALARM_DISTANCE, CALM_DISTANCE = 0.8, 1.04  # m to the nearest seen pursuer
WANDER_SPEED = 0.15  # m/s of a calm evader
WANDER_TURN = 0.3  # standard deviation of the turn of a calm evader in a control step, rad
WANDER_ROOM, WANDER_REACH = 0.2, 0.4  # m; a calm evader turns if so far ahead is less clearance
TURN_COS, TURN_SIN = 0.5403023058681398, 0.8414709848078965  # of 1 rad, by which it then turns

CLEARANCE_WEIGHT, USEFUL_CLEARANCE, MIDDLE_WEIGHT = 0.25, 0.6, 0.3
"""Of the value of a heading: per metre of clearance, of which more is no better, m; and per half
width of the arena from its middle."""

CAUGHT_VALUE = -10.0  # of a heading on which it is caught at once, far below all others
SOLID_TOLERANCE = 1e-6  # m by which rounding may bring an evader into something solid

_STREAM = STREAMS["layout"]


def direction_table(n: int) -> Double:
    """Returns n unit vectors, evenly spaced, [n, 2]; rounded, so the same on every platform."""
    angles = [2.0 * math.pi * k / n for k in range(n)]
    scale = 2.0**40
    return np.array([[round(f(a) * scale) / scale for f in (math.cos, math.sin)] for a in angles])


class EvaderModel(NamedTuple):
    """Constants of evaders."""

    speed: float  # m/s
    radius: float  # m
    capture_radius: float  # m
    pursuer_speed: float  # m/s
    dt: float  # s, of a control step
    half: Double  # [2] m, half width and half height of the arena
    headings: Double  # [N_HEADINGS, 2]
    normals: Double  # `random.normal_table`
    sight_range: float = 1.6  # m
    sees_through: bool = False  # whether obstacles do not hide pursuers
    lookahead: float = 1.5  # s
    margin: float = 0.03  # m, beyond the capture radius
    fears_ambush: bool = False  # whether pursuers might as well stay where they are

    @classmethod
    def of(cls, spec: TaskSpec, rules: PursuitRules) -> Self:
        top = max(robot.max_speed for robot in spec.robots)
        return cls(
            rules.speed_ratio * top, rules.evader_radius, rules.capture_radius, top,
            spec.control_dt, np.array(spec.half_size), direction_table(N_HEADINGS),
            normal_table(), **EVADERS[rules.evader],
        )  # fmt: skip


EVADERS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "lookahead": {},
        "all_seeing": {"sight_range": 1e3, "sees_through": True},
        "two_models": {"fears_ambush": True},
        "wide_margin": {"margin": 0.15},
        "far_lookahead": {"lookahead": 2.5},
        "short_sight": {"sight_range": 1.0},
    }
)
"""The fields of `EvaderModel` in which each rule differs from the default one."""


@kernel(error_model="numpy")
def slide(
    x: float, y: float, dx: float, dy: float, layout: Float, half: Double, radius: float
) -> tuple[float, float]:
    """Where a disc comes to that moves by (dx, dy), m, along obstacles and walls in its way.

    It is free at (x, y), moves by less than its radius, and stays if the way round is not that
    simple. `layout` is [M, 8].
    """
    room_x, room_y = half[0] - radius, half[1] - radius
    to_x, to_y = x + dx, y + dy
    for _ in range(2):
        is_free = True
        to_x, to_y = min(max(to_x, -room_x), room_x), min(max(to_y, -room_y), room_y)
        for m in range(layout.shape[0]):
            if layout[m, 0] == CIRCLE:
                vx, vy = to_x - np.float64(layout[m, 1]), to_y - np.float64(layout[m, 2])
                reach, square = np.float64(layout[m, 5]) + radius, vx * vx + vy * vy
                if square >= reach * reach or square == 0.0:
                    continue
                d = math.sqrt(square)
                push = (reach - d) / d
            else:
                d, vx, vy = nearest_of(to_x, to_y, layout, m)
                if d >= radius or d == 0.0:
                    continue
                push = -(radius - d) / d
            to_x, to_y, is_free = to_x + push * vx, to_y + push * vy, False
        if is_free:
            break
    if clearance(to_x, to_y, layout, half) < radius - SOLID_TOLERANCE:
        return x, y
    return to_x, to_y


@kernel(error_model="numpy")
def heading_value(
    heading: int,  # row of `model.headings`
    place: tuple[float, float],  # of the evader, m
    seen: Double,  # [P, 2] places of the pursuers that it sees, m
    stays: bool,  # whether these stay where they are; otherwise they drive at the evader
    layout: Float,  # [M, 8] obstacles
    model: EvaderModel,  # of evaders
) -> float:
    """How good it is to flee along a heading; see the module."""
    time = model.lookahead / N_ROLL_STEPS
    step, reach = model.speed * time, model.pursuer_speed * time
    dx, dy = step * model.headings[heading, 0], step * model.headings[heading, 1]
    caught = model.capture_radius + model.margin
    x, y = place
    pursuers, nearest = seen.copy(), math.inf
    for t in range(N_ROLL_STEPS):
        x, y = slide(x, y, dx, dy, layout, model.half, model.radius)
        nearest = math.inf
        for j in range(pursuers.shape[0]):
            wx, wy = x - pursuers[j, 0], y - pursuers[j, 1]
            d = math.sqrt(wx * wx + wy * wy)
            if not stays:
                share = min(reach / max(d, 1e-9), 1.0)
                pursuers[j, 0] += share * wx
                pursuers[j, 1] += share * wy
                d -= share * d
            nearest = min(nearest, d)
        if nearest < caught:
            return CAUGHT_VALUE + t * time
    wx, wy = x / model.half[0], y / model.half[1]
    room = min(clearance(x, y, layout, model.half), USEFUL_CLEARANCE)
    return float(nearest + CLEARANCE_WEIGHT * room - MIDDLE_WEIGHT * math.sqrt(wx * wx + wy * wy))


@kernel
def best_heading(
    place: tuple[float, float], seen: Double, layout: Float, model: EvaderModel
) -> int:
    """The heading of largest value, the first of equal ones; arguments as of `heading_value`."""
    best, most = 0, -math.inf
    for heading in range(N_HEADINGS):
        value = heading_value(heading, place, seen, False, layout, model)
        if model.fears_ambush:
            value = min(value, heading_value(heading, place, seen, True, layout, model))
        if value > most:
            best, most = heading, value
    return best


@kernel
def look_for_pursuers(
    place: tuple[float, float], robots: Double, layout: Float, model: EvaderModel, seen: Double
) -> tuple[int, float]:
    """Writes the places of the pursuers, at `robots` [N, 2], that an evader sees, m, [N, 2].

    Returns:
        How many it sees, and the distance to the nearest of them, m.
    """
    count, nearest, most = 0, math.inf, model.sight_range * model.sight_range
    x, y = place
    for i in range(robots.shape[0]):
        dx, dy = robots[i, 0] - x, robots[i, 1] - y
        square = dx * dx + dy * dy
        if square < most and (
            model.sees_through or is_in_sight(x, y, robots[i, 0], robots[i, 1], layout)
        ):
            seen[count, 0], seen[count, 1] = robots[i, 0], robots[i, 1]
            count, nearest = count + 1, min(nearest, math.sqrt(square))
    return count, nearest


@kernel(error_model="numpy")
def wander(
    place: tuple[float, float],  # m
    heading: tuple[float, float],  # unit vector
    bits: np.uint64,  # random
    layout: Float,  # [M, 8] obstacles
    model: EvaderModel,  # of evaders
) -> tuple[float, float, float]:
    """The next heading of a calm evader, and its speed, m/s."""
    t = 0.5 * WANDER_TURN * to_normal(bits, model.normals)  # tangent of half the angle, nearly
    scale = 1.0 / (1.0 + t * t)
    cos, sin = (1.0 - t * t) * scale, 2.0 * t * scale
    ux, uy = heading[0] * cos - heading[1] * sin, heading[0] * sin + heading[1] * cos
    norm = math.sqrt(ux * ux + uy * uy)
    ux, uy = ux / norm, uy / norm
    ahead = clearance(
        place[0] + WANDER_REACH * ux, place[1] + WANDER_REACH * uy, layout, model.half
    )
    if ahead < WANDER_ROOM:
        return ux * TURN_COS - uy * TURN_SIN, ux * TURN_SIN + uy * TURN_COS, 0.0
    return ux, uy, WANDER_SPEED


@kernel(error_model="numpy")
def move_among(
    place: tuple[float, float],  # of the evader, m
    dx: float,  # m
    dy: float,  # m
    robots: Double,  # [N, 2] their places after the step, m
    radii: Double,  # [N] of the robots, m
    layout: Float,  # [M, 8] obstacles
    model: EvaderModel,  # of evaders
) -> tuple[float, float]:
    """Where an evader comes to that moves by (dx, dy), and then gives way to the robots."""
    x, y = place
    length = math.sqrt(dx * dx + dy * dy)
    n_parts = 1 + int(2.0 * length / model.radius)
    for _ in range(n_parts):
        x, y = slide(x, y, dx / n_parts, dy / n_parts, layout, model.half, model.radius)
    for i in range(robots.shape[0]):
        wx, wy = x - robots[i, 0], y - robots[i, 1]
        d, need = math.sqrt(wx * wx + wy * wy), radii[i] + model.radius
        if 0.0 < d < need:
            push = (need - d) / d
            x, y = slide(x, y, push * wx, push * wy, layout, model.half, model.radius)
    return x, y


@kernel(error_model="numpy")
def next_place(
    place: tuple[float, float],  # m
    velocity: tuple[float, float],  # m/s
    robots: Double,  # [N, 2] their places after the step, m
    radii: Double,  # [N] of the robots, m
    layout: Float,  # [M, 8] obstacles
    model: EvaderModel,  # of evaders
) -> tuple[float, float]:
    """As `move_among` with a velocity (m/s) for a control step, never faster than evaders are.

    What slides and gives way may come farther than it wanted; then it wants less.
    """
    most = model.speed * model.dt
    for part in range(5):
        share = 1.0 - 0.25 * part
        dx, dy = share * velocity[0] * model.dt, share * velocity[1] * model.dt
        x, y = move_among(place, dx, dy, robots, radii, layout, model)
        wx, wy = x - place[0], y - place[1]
        if wx * wx + wy * wy <= most * most:
            return x, y
    return place


@kernel
def evade(
    place: tuple[float, float],  # m
    facing: tuple[float, float],  # unit vector, in which it wanders
    was_alarmed: bool,  # in the step before
    bits: np.uint64,  # random
    robots: Double,  # [N, 2] their places before the step, by which it decides, m
    moved: Double,  # [N, 2] their places after the step, to which it gives way, m
    radii: Double,  # [N] of the robots, m
    layout: Float,  # [M, 8] obstacles
    model: EvaderModel,  # of evaders
) -> tuple[bool, float, float, float, float]:
    """Whether an evader is alarmed, the heading in which it wanders, and where it comes to, m."""
    seen, (ux, uy) = np.empty_like(robots), facing
    n_seen, nearest = look_for_pursuers(place, robots, layout, model, seen)
    is_alarmed = nearest < (CALM_DISTANCE if was_alarmed else ALARM_DISTANCE)
    if is_alarmed:
        heading = model.headings[best_heading(place, seen[:n_seen], layout, model)]
        velocity = (model.speed * heading[0], model.speed * heading[1])
    else:
        ux, uy, speed = wander(place, facing, bits, layout, model)
        velocity = (speed * ux, speed * uy)
    x, y = next_place(place, velocity, moved, radii, layout, model)
    return is_alarmed, ux, uy, x, y


@kernel
def random_bits(seed: np.uint64, time: int, evader: int) -> np.uint64:
    """Random bits of an evader in a control step."""
    return absorb(absorb(absorb(seed, _STREAM), time), evader)
