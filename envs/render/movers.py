"""Draws moving things: robots with the mark of their role, payloads, trails, halos of contacts."""

import numpy as np

from swarmdata.envs.render.canvas import Canvas
from swarmdata.envs.render.colors import (
    CONTACT_COLOR,
    PAYLOAD_COLOR,
    PAYLOAD_EDGE_COLOR,
    TEXT_COLOR,
    WHITE,
    robot_color,
    tint,
)
from swarmdata.envs.render.drawn_scene import Scene
from swarmdata.envs.render.targets import payload_outline
from swarmdata.specs.state_layout import X, Y
from swarmdata.types import Double

_WEDGE_POLYGON = np.array([(0.75, 0.0), (-0.4, 0.5), (-0.15, 0.0), (-0.4, -0.5)])
_TRIANGLE_POLYGON = np.array([(0.55, 0.0), (-0.35, 0.42), (-0.35, -0.42)])
_CHEVRON_POLYGON = np.array(
    [(0.3, 0.0), (-0.1, 0.55), (-0.36, 0.55), (0.0, 0.0), (-0.36, -0.55), (-0.1, -0.55)]
)
_CHEVRON_PAIR = [_CHEVRON_POLYGON + np.array([0.35, 0.0]), _CHEVRON_POLYGON - np.array([0.12, 0.0])]
_ROLE_MARKS = ([_WEDGE_POLYGON], [_TRIANGLE_POLYGON], _CHEVRON_PAIR, [0.8 * _WEDGE_POLYGON])
"""Polygons of each role, as (ahead, left) in robot radii; a fifth role looks like the first."""


def draw_trails(canvas: Canvas, scene: Scene) -> None:
    """Draws past positions as lines that become thinner and paler with age."""
    n = len(scene.robots)
    for i, places in enumerate(np.moveaxis(scene.trails, 1, 0)):
        color = robot_color(i) if i < n else PAYLOAD_EDGE_COLOR
        for k in range(1, len(places)):
            recency = k / len(places)
            shade, width = tint(color, 0.1 + 0.5 * recency), 0.015 + 0.025 * recency
            canvas.line(places[k - 1 : k + 1], shade, width)
            x, y = places[k].tolist()
            canvas.disc(x, y, canvas.thickness(width) / canvas.scale / 2, shade)


def draw_bodies(canvas: Canvas, scene: Scene) -> None:
    """Draws movable bodies with an arrow along their local x axis."""
    for payload, body in zip(scene.look.bodies, scene.bodies, strict=True):
        place, towards = body[:2], body[4:6]
        outline = payload_outline(payload, place, towards)
        canvas.polygon(outline, PAYLOAD_COLOR)
        canvas.loop(outline, PAYLOAD_EDGE_COLOR, 0.03)
        length = 0.7 * payload.half_length
        shaft = np.array([place - 0.6 * length * towards, place + 0.7 * length * towards])
        canvas.line(shaft, PAYLOAD_EDGE_COLOR, 0.03)
        head = np.array([(1.0, 0.0), (0.5, 0.28), (0.5, -0.28)]) * length
        heading = float(towards[0]), float(towards[1])
        canvas.polygon(_turned(head, place, heading), PAYLOAD_EDGE_COLOR)


def draw_robots(canvas: Canvas, scene: Scene) -> None:
    """Draws the halos of robots in contact, then all robots above them."""
    for i in np.flatnonzero(scene.touching).tolist():
        x, y = scene.robots[i, [X, Y]].tolist()
        canvas.disc(x, y, 1.45 * scene.radii[i], CONTACT_COLOR)
    for i, row in enumerate(scene.robots):
        x, y = row[[X, Y]].tolist()
        radius = float(scene.radii[i])
        canvas.disc(x, y, 1.1 * radius, WHITE)
        canvas.disc(x, y, radius, robot_color(i))
        _mark(canvas, scene, i)


def _mark(canvas: Canvas, scene: Scene, i: int) -> None:
    """Draws a role's mark along the heading: wedge, ringed triangle, double chevron, wedge on dark.

    A holonomic robot at rest gets a dot instead, in the same ring or on the same dark disc.
    """
    place, radius, heading = scene.robots[i, [X, Y]], float(scene.radii[i]), scene.heading(i)
    x, y = place.tolist()
    role, color = scene.roles[i] % 4, WHITE
    if role == 1:
        canvas.disc(x, y, 0.86 * radius, None, outline=WHITE, width=0.13 * radius)
    elif role == 3:
        canvas.disc(x, y, 0.76 * radius, TEXT_COLOR)
    if heading is not None:
        for shape in _ROLE_MARKS[role]:
            canvas.polygon(_turned(radius * shape, place, heading), color)
    elif role == 2:
        canvas.disc(x, y, 0.4 * radius, None, outline=WHITE, width=0.2 * radius)
    else:
        canvas.disc(x, y, 0.22 * radius, color)


def _turned(shape: Double, place: Double, heading: tuple[float, float]) -> Double:
    """Returns the positions of points given as (ahead, left), [K, 2]."""
    ux, uy = heading
    ahead, left = shape[:, 0], shape[:, 1]
    return place + np.stack([ahead * ux - left * uy, ahead * uy + left * ux], axis=1)
