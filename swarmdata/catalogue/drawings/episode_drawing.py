"""A small drawing of an episode: obstacles, targets, the ways of the robots and where they end."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.drawings.svg_shapes import Point
from swarmdata.catalogue.elements import Html, element
from swarmdata.envs.physics.public_backend import bars
from swarmdata.envs.render.colors import robot_color
from swarmdata.envs.render.drawn_scene import Scene, build_scene
from swarmdata.envs.render.targets import Target, payload_outline, targets_of, wanted_outline
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float

SIDE = 200.0  # units of the drawing, of the arena's longer side
MOST_POINTS = 48  # of a robot's way
MOST_BARS = 3  # of an obstacle

Places = Callable[[NDArray[Any]], list[Point]]
"""Turns positions in metres, [K, 2], into points of the drawing."""


def episode_drawing(spec: TaskSpec, layout: Float, states: Float, label: str) -> Html:
    """Draws an episode, of all states [T+1, S], or a world at its start, of one.

    Rows of the layout are obstacles, columns `geometry.OBSTACLE`, [M, 8].
    """
    scale = SIDE / max(spec.arena.width, spec.arena.height)
    width, height = spec.arena.width * scale, spec.arena.height * scale

    def place(x: float, y: float) -> Point:
        return width / 2 + x * scale, height / 2 - y * scale

    def places(points: NDArray[Any]) -> list[Point]:
        return [place(x, y) for x, y in points.tolist()]

    some = states[np.unique(np.linspace(0, len(states) - 1, MOST_POINTS).astype(int))]
    ways = robots_of(some, spec.n_agents)
    scene = build_scene(spec, layout, some[-1])
    parts = [_obstacle(row, places, scale) for row in layout]
    parts += _bodies(scene, places)
    targets = (
        []
        if scene.look.mark == "pose"
        else targets_of(scene.look, spec, scene.robots, scene.extras)
    )
    marks = [(each.robot, _mark(scene, each, place, scale)) for each in targets]
    parts += [mark for robot, mark in marks if robot is None]
    own = dict(marks)
    for i, robot in enumerate(spec.robots):
        way = svg_shapes.path(places(ways[:, i][:, [X, Y]]), class_="way") if len(some) > 1 else ""
        at = place(*ways[-1, i, [X, Y]].tolist())
        body = svg_shapes.disc(at, robot.radius * scale, class_="robot")
        color = svg_shapes.hex_color(robot_color(i))
        parts.append(element("g", own.get(i, ""), way, body, color=color))
    return svg_shapes.drawing(width, height, label, *parts, class_="world")


def _obstacle(row: Float, places: Places, scale: float) -> Html:
    if row[0] == CIRCLE:
        (center,) = places(row[None, 1:3])
        return svg_shapes.disc(center, float(row[5]) * scale, class_="obstacle")
    corners = np.empty((MOST_BARS, 4, 2))
    found = corners[: bars(row, corners)]
    return element(
        "g", *(svg_shapes.path(places(bar), closed=True) for bar in found), class_="obstacle"
    )


def _bodies(scene: Scene, places: Places) -> list[Html]:
    """Movable bodies, and where the first should be if the task wants a pose."""
    found = []
    if scene.look.mark == "pose":
        wanted = wanted_outline(scene.look, scene.robots, scene.bodies, scene.extras)
        found.append(svg_shapes.path(places(wanted), closed=True, class_="wanted"))
    for payload, body in zip(scene.look.bodies, scene.bodies, strict=True):
        outline = payload_outline(payload, body[:2], body[4:6])
        found.append(svg_shapes.path(places(outline), closed=True, class_="payload"))
    return found


def _mark(
    scene: Scene, target: Target, place: Callable[[float, float], Point], scale: float
) -> Html:
    """The mark of a target, in the color of its robot, or neutral if it has none."""
    x, y = at = place(target.x, target.y)
    if scene.look.mark == "ring":
        kind = "goal" if target.robot is not None else "goal shared"
        return svg_shapes.disc(at, target.radius * scale, class_=kind)
    arm = 0.07 * scale
    cross = [svg_shapes.line((x - arm, y - arm), (x + arm, y + arm))]
    cross.append(svg_shapes.line((x - arm, y + arm), (x + arm, y - arm)))
    return element("g", *cross, class_="slot")
