"""Draws the targets of a state: rings, slots of a formation, the goal pose of a payload."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from swarmdata.envs.render.canvas import Canvas
from swarmdata.envs.render.colors import (
    PAYLOAD_EDGE_COLOR,
    UNASSIGNED_COLOR,
    Color,
    ink,
    robot_color,
    tint,
)
from swarmdata.envs.render.drawn_scene import Scene
from swarmdata.envs.render.targets import Target, direction_of, targets_of, wanted_outline
from swarmdata.specs.state_layout import TX, TY, X, Y

_LINE_WIDTH = 0.022  # m
_SAME_PLACE_DISTANCE = 0.01  # m; closer targets are one place


def draw_targets(canvas: Canvas, scene: Scene) -> None:
    """Draws where the robots, or their payload, should be, as the task's `Appearance` says."""
    look = scene.look
    targets = targets_of(look, scene.spec, scene.robots, scene.extras)
    _PAINTERS[look.mark](canvas, scene, targets)


def _rings(canvas: Canvas, scene: Scene, targets: list[Target]) -> None:
    """Draws a ring per target, filled once reached; rings of one place nest."""
    _links(canvas, scene)
    places = np.array([(each.x, each.y) for each in targets])
    for i, each in enumerate(targets):
        color = UNASSIGNED_COLOR if each.robot is None else robot_color(each.robot)
        radius = each.radius
        if each.robot is not None:
            earlier = np.hypot(*(places[:i] - places[i]).T) < _SAME_PLACE_DISTANCE
            radius *= max(0.25, 1.0 - 0.25 * int(earlier.sum()))
        _ring(canvas, each.x, each.y, radius, color, is_reached=each.is_reached)


def _links(canvas: Canvas, scene: Scene) -> None:
    """Draws dashes from each robot to its own target, where the task has them and the robot one."""
    look = scene.look
    if not look.is_linked:
        return
    for i, row in enumerate(scene.robots):
        target = row[[TX, TY]]
        if look.nowhere is None or np.hypot(*(target - look.nowhere)) > _SAME_PLACE_DISTANCE:
            way = np.linspace(row[[X, Y]], target, 24)
            canvas.dashes(way, ink(robot_color(i), 0.5), 0.014, 0.06)


def _ring(
    canvas: Canvas, x: float, y: float, radius: float, color: Color, *, is_reached: bool
) -> None:
    if is_reached:  # the robot hides most of the ring, so a glow is drawn around it
        canvas.disc(x, y, 1.35 * radius, tint(color, 0.25))
    fill = tint(color, 0.5 if is_reached else 0.1)
    canvas.disc(x, y, radius, fill, outline=color, width=_LINE_WIDTH)
    if not is_reached:
        canvas.disc(x, y, 0.025, color)


def _slots(canvas: Canvas, scene: Scene, targets: list[Target]) -> None:
    """Draws each target as a cross in its robot's color, linked to it, on a disc while held."""
    for each, row in zip(targets, scene.robots, strict=True):
        color, slot = robot_color(each.robot or 0), np.array([each.x, each.y])
        if each.is_reached:
            canvas.disc(each.x, each.y, each.radius, tint(color, 0.3))
        elif scene.look.is_linked:
            canvas.dashes(np.linspace(row[[X, Y]], slot, 8), ink(color, 0.5), 0.014, 0.035)
        for arm in ((0.07, 0.07), (0.07, -0.07)):
            canvas.line(np.array([slot - arm, slot + arm]), color, 0.028)


def _pose(canvas: Canvas, scene: Scene, _targets: list[Target]) -> None:
    """Draws the payload's outline at its goal, its direction, and the disc its centre must reach.

    If any direction will do, the outline has the payload's current direction.
    """
    look, goal, body = scene.look, scene.robots[0, [TX, TY]], scene.bodies[0]
    radius = look.radius or 0.0
    outline = wanted_outline(scene.look, scene.robots, scene.bodies, scene.extras)
    is_reached = bool(np.hypot(*(goal - body[:2])) <= radius)
    canvas.polygon(outline, tint(PAYLOAD_EDGE_COLOR, 0.12))
    canvas.disc(goal[0], goal[1], radius, tint(PAYLOAD_EDGE_COLOR, 0.5 if is_reached else 0.22))
    closed = np.vstack([outline, outline[:1]])
    dense = np.concatenate([np.linspace(a, b, 12) for a, b in pairwise(closed)])
    canvas.dashes(dense, PAYLOAD_EDGE_COLOR, 0.028, 0.06)
    if look.direction is not None:
        towards = direction_of(look, scene.bodies, scene.extras)
        tip = goal + towards * scene.look.bodies[0].half_length
        canvas.line(np.array([goal, tip]), PAYLOAD_EDGE_COLOR, 0.02)


_PAINTERS: dict[str, Callable[[Canvas, Scene, list[Target]], None]] = {
    "ring": _rings,
    "slot": _slots,
    "pose": _pose,
}
"""The function that draws each kind of mark."""
