"""Impacts: a physics step ends where bodies begin to overlap, so that overlaps stay shallow.

Munk2D moves bodies first and then stops those that overlap, in a step of 50 ms by up to 60 mm. So a
step that would press bodies together by more than `DEEPEST_OVERLAP` is taken in parts: up to the
first touch, found by bisection, then the rest. What touches within a part goes unnoticed.
"""

import math

from swarmdata.numerics.geometry import nearest_of, nearest_of_shape, outer_radius, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float

DEEPEST_OVERLAP = 0.0025  # m that a part of a physics step may move bodies into each other
CREEP = 0.0005  # m that deeper overlaps may grow in a part: the solver stops them only nearly
N_HALVINGS = 5  # of the time, in the search for the touch

MOST_PARTS = 16
"""Of a physics step. In the shortest part of a step of 50 ms, bodies that close at more than
0.8 m/s may overlap by more than `DEEPEST_OVERLAP`."""


@kernel(inline="always")
def _deepens(old: float, new: float) -> bool:
    return new < -DEEPEST_OVERLAP and new < old - CREEP


@kernel(inline="always")
def _body_gap(px: float, py: float, body: Double, shape: Double, time: float) -> float:
    """Distance (m) from a point to a movable body `time` seconds later."""
    ux, uy = body[4] - body[5] * body[6] * time, body[5] + body[4] * body[6] * time
    norm = math.sqrt(ux * ux + uy * uy)
    x, y = body[0] + body[2] * time, body[1] + body[3] * time
    return nearest_of_shape(
        px, py, shape[0], x, y, ux / norm, uy / norm, shape[1], shape[2], 0.0
    )[0]  # fmt: skip


@kernel
def _deepens_static(
    px: float, py: float, qx: float, qy: float, radius: float, layout: Float, half: Double
) -> bool:
    """Whether moving a robot from p to q presses it into an obstacle or a wall."""
    for wall in range(4):
        new = wall_gap(qx, qy, half, wall) - radius
        if _deepens(wall_gap(px, py, half, wall) - radius, new):
            return True
    for m in range(layout.shape[0]):
        dx, dy = float(layout[m, 1]) - qx, float(layout[m, 2]) - qy
        reach = outer_radius(layout[m]) + radius
        if dx * dx + dy * dy < reach * reach:
            new = nearest_of(qx, qy, layout, m)[0] - radius
            if _deepens(nearest_of(px, py, layout, m)[0] - radius, new):
                return True
    return False


@kernel
def _is_deep(
    robots: Double,
    bodies: Double,
    time: float,
    radii: Double,
    shapes: Double,
    layout: Float,
    half: Double,
    slack: Double,
) -> bool:
    """Whether moving on by the velocities for `time` seconds makes an overlap deep."""
    for i in range(robots.shape[0]):
        px, py = robots[i, 0], robots[i, 1]
        qx, qy = px + robots[i, 2] * time, py + robots[i, 3] * time
        for j in range(i + 1, robots.shape[0]):
            dx = robots[j, 0] + robots[j, 2] * time - qx
            dy = robots[j, 1] + robots[j, 3] * time - qy
            touch = radii[i] + radii[j]
            if dx * dx + dy * dy < touch * touch:
                new = math.sqrt(dx * dx + dy * dy) - touch
                dx, dy = robots[j, 0] - px, robots[j, 1] - py
                if _deepens(math.sqrt(dx * dx + dy * dy) - touch, new):
                    return True
        for k in range(bodies.shape[0]):
            dx = bodies[k, 0] + bodies[k, 2] * time - qx
            dy = bodies[k, 1] + bodies[k, 3] * time - qy
            reach = radii[i] + shapes[k, 1] + shapes[k, 2]  # not below a bounding circle's
            if dx * dx + dy * dy > reach * reach:
                continue
            new = _body_gap(qx, qy, bodies[k], shapes[k], time) - radii[i]
            if new < -DEEPEST_OVERLAP:
                old = _body_gap(px, py, bodies[k], shapes[k], 0.0) - radii[i]
                if _deepens(old, new):
                    return True
        moved = abs(qx - slack[i, 0]) + abs(qy - slack[i, 1])
        if slack[i, 2] < moved and _deepens_static(px, py, qx, qy, radii[i], layout, half):
            return True
    return False


@kernel
def time_to_impact(
    robots: Double,  # [N, 6]
    bodies: Double,  # [K, 7] movable bodies
    left: float,  # what is left of the physics step, s
    dt: float,  # length of the physics step, s
    radii: Double,  # [N] m
    shapes: Double,  # [K, 3] shape code, half length and half width of the movable bodies
    layout: Float,  # [M, 8] obstacles
    half: Double,  # [2] half width and half height of the arena, m
    slack: Double,  # [N, 3] `backend.Contacts.slack` of this copy
) -> float:
    """Returns the length of the next part of a physics step, s."""
    if not _is_deep(robots, bodies, left, radii, shapes, layout, half, slack):
        return left
    early, late = 0.0, left
    for _ in range(N_HALVINGS):
        middle = 0.5 * (early + late)
        if _is_deep(robots, bodies, middle, radii, shapes, layout, half, slack):
            late = middle
        else:
            early = middle
    return min(max(early, dt / MOST_PARTS), left)
