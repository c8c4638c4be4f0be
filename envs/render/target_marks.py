"""Draws the targets of each task: rings, slots of a formation, the goal pose of a payload."""

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
from swarmdata.specs.rules import (
    FormationRules,
    IntersectionRules,
    NavigationRules,
    Payload,
    SearchRules,
    TransportRules,
    WarehouseRules,
)
from swarmdata.specs.state_layout import TX, TY, X, Y
from swarmdata.types import Double

_LINE_WIDTH = 0.022  # m
_SAME_PLACE_DISTANCE = 0.01  # m; closer targets are one place


def draw_targets(canvas: Canvas, scene: Scene) -> None:
    """Draws where the robots, or their payload, should be."""
    _TARGET_PAINTERS.get(scene.spec.task, _own_targets)(canvas, scene)


def _own_targets(canvas: Canvas, scene: Scene) -> None:
    """Draws the targets of robots in a user's task, as far from a robot as its radius reaches."""
    for i, (x, y) in enumerate(scene.robots[:, [TX, TY]].tolist()):
        gap = float(np.hypot(*(scene.robots[i, [X, Y]] - (x, y))))
        radius = scene.spec.robots[i].radius
        _ring(canvas, x, y, radius, robot_color(i), is_reached=gap <= radius)


def _goals(canvas: Canvas, scene: Scene) -> None:
    """Draws a ring per goal in its robot's color, filled once reached; neutral if unassigned."""
    rules = scene.spec.rules
    assert isinstance(rules, NavigationRules | WarehouseRules | IntersectionRules)
    radius = rules.goal_radius
    is_shared = isinstance(rules, NavigationRules) and rules.goals == "unassigned"
    places, targets = scene.robots[:, [X, Y]], scene.robots[:, [TX, TY]]
    if is_shared:  # targets are then the nearest open goals; the extras are all goals
        targets = scene.extras.reshape(-1, 2)
    gaps = np.hypot(*np.moveaxis(targets[:, None] - places[None], -1, 0))  # [targets, robots]
    for i, (x, y) in enumerate(targets.tolist()):
        if is_shared:
            _ring(canvas, x, y, radius, UNASSIGNED_COLOR, is_reached=bool(gaps[i].min() <= radius))
            continue
        # rings of one place nest
        earlier = np.hypot(*(targets[:i] - targets[i]).T) < _SAME_PLACE_DISTANCE
        inner = radius * max(0.25, 1.0 - 0.25 * int(earlier.sum()))
        _ring(canvas, x, y, inner, robot_color(i), is_reached=bool(gaps[i, i] <= radius))


def _victims(canvas: Canvas, scene: Scene) -> None:
    """Draws a ring per victim, filled once it is rescued, and a link from each robot to its own."""
    rules = scene.spec.rules
    assert isinstance(rules, SearchRules)
    victims = scene.extras[: 2 * rules.victims].reshape(-1, 2)
    rescued = scene.extras[2 * rules.victims :][: rules.victims] > 0.0
    base = np.array(scene.spec.half_size) * -1.0
    for i, row in enumerate(scene.robots):
        if np.hypot(*(row[[TX, TY]] - base)) > _SAME_PLACE_DISTANCE:
            way = np.linspace(row[[X, Y]], row[[TX, TY]], 24)
            canvas.dashes(way, ink(robot_color(i), 0.5), 0.014, 0.06)
    for (x, y), is_rescued in zip(victims.tolist(), rescued.tolist(), strict=True):
        _ring(canvas, x, y, rules.goal_radius, UNASSIGNED_COLOR, is_reached=is_rescued)


def _ring(
    canvas: Canvas, x: float, y: float, radius: float, color: Color, *, is_reached: bool
) -> None:
    if is_reached:  # the robot hides most of the ring, so a glow is drawn around it
        canvas.disc(x, y, 1.35 * radius, tint(color, 0.25))
    fill = tint(color, 0.5 if is_reached else 0.1)
    canvas.disc(x, y, radius, fill, outline=color, width=_LINE_WIDTH)
    if not is_reached:
        canvas.disc(x, y, 0.025, color)


def _slots(canvas: Canvas, scene: Scene) -> None:
    """Draws each robot's slot as a cross in its color, linked to it, on a disc while it is held."""
    rules = scene.spec.rules
    assert isinstance(rules, FormationRules)
    for i, row in enumerate(scene.robots):
        color, slot, place = robot_color(i), row[[TX, TY]], row[[X, Y]]
        gap = float(np.hypot(*(slot - place)))
        if gap <= rules.tolerance:
            canvas.disc(slot[0], slot[1], rules.tolerance, tint(color, 0.3))
        else:
            canvas.dashes(np.linspace(place, slot, 8), ink(color, 0.5), 0.014, 0.035)
        for arm in ((0.07, 0.07), (0.07, -0.07)):
            canvas.line(np.array([slot - arm, slot + arm]), color, 0.028)


def _payload_goal(canvas: Canvas, scene: Scene) -> None:
    """Draws the payload's outline at its goal, its direction, and the disc its centre must reach.

    The goal's direction is in the first two extras of the state. If any direction will do, the
    outline has the payload's current direction.
    """
    rules = scene.spec.rules
    assert isinstance(rules, TransportRules)
    goal, body = scene.robots[0, [TX, TY]], scene.bodies[0]
    has_direction = rules.goal_angle is not None and len(scene.extras) >= 2
    towards = scene.extras[:2] if has_direction else body[4:6]
    outline = payload_outline(rules.payload, goal, towards)
    is_reached = bool(np.hypot(*(goal - body[:2])) <= rules.goal_radius)
    canvas.polygon(outline, tint(PAYLOAD_EDGE_COLOR, 0.12))
    canvas.disc(
        goal[0], goal[1], rules.goal_radius, tint(PAYLOAD_EDGE_COLOR, 0.5 if is_reached else 0.22)
    )
    closed = np.vstack([outline, outline[:1]])
    dense = np.concatenate([np.linspace(a, b, 12) for a, b in pairwise(closed)])
    canvas.dashes(dense, PAYLOAD_EDGE_COLOR, 0.028, 0.06)
    if has_direction:
        tip = goal + towards * rules.payload.half_length
        canvas.line(np.array([goal, tip]), PAYLOAD_EDGE_COLOR, 0.02)


def payload_outline(payload: Payload, place: Double, towards: Double) -> Double:
    """Returns the corners of a payload whose local x axis is the unit vector `towards`, [K, 2]."""
    side = np.array([-towards[1], towards[0]])
    if payload.shape == "circle":
        angles = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
        local = payload.half_length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        half = np.array([payload.half_length, payload.half_width])
        local = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return place + local[:, :1] * towards + local[:, 1:] * side


_TARGET_PAINTERS: dict[str, Callable[[Canvas, Scene], None]] = {
    "coop_nav": _goals,
    "formation": _slots,
    "intersection": _goals,
    "search": _victims,
    "transport": _payload_goal,
    "warehouse": _goals,
}
"""The function that draws the targets of each task."""
