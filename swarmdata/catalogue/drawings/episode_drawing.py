"""A small drawing of an episode: obstacles, targets, the ways of the robots and where they end."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.drawings.svg_shapes import Point
from swarmdata.catalogue.elements import Html, element, join
from swarmdata.envs.physics.public_backend import bars
from swarmdata.envs.render.colors import robot_color
from swarmdata.envs.render.target_marks import payload_outline
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.specs.rules import NavigationRules, TransportRules, WarehouseRules
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float

SIDE = 200.0  # units of the drawing, of the arena's longer side
MOST_POINTS = 48  # of a robot's way
MOST_BARS = 3  # of an obstacle

Places = Callable[[NDArray[Any]], list[Point]]
"""Turns positions in metres, [K, 2], into points of the drawing."""


def episode_drawing(spec: TaskSpec, layout: Float, states: Float, label: str) -> Html:
    """Draws an episode, or a world at its start.

    Args:
        spec: of the task.
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].
        states: all states, [T+1, S], or one.
        label: for screen readers.
    """
    scale = SIDE / max(spec.arena.width, spec.arena.height)
    width, height = spec.arena.width * scale, spec.arena.height * scale

    def place(x: float, y: float) -> Point:
        return width / 2 + x * scale, height / 2 - y * scale

    def places(points: NDArray[Any]) -> list[Point]:
        return [place(x, y) for x, y in points.tolist()]

    some = states[np.unique(np.linspace(0, len(states) - 1, MOST_POINTS).astype(int))]
    ways = robots_of(some, spec.n_agents)
    robots, parts = ways[-1], []
    parts += [_obstacle(row, places, scale) for row in layout]
    parts += _payload(spec, some[-1], places)
    for i, robot in enumerate(spec.robots):
        color = "#{:02x}{:02x}{:02x}".format(*robot_color(i))
        at, target = place(*robots[i, [X, Y]].tolist()), place(*robots[i, [TX, TY]].tolist())
        mark = _target(spec, target, scale)
        way = svg_shapes.path(places(ways[:, i][:, [X, Y]]), class_="way") if len(some) > 1 else ""
        body = svg_shapes.disc(at, robot.radius * scale, class_="robot")
        parts.append(element("g", mark, way, body, color=color))
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


def _payload(spec: TaskSpec, state: Float, places: Places) -> list[Html]:
    if not isinstance(spec.rules, TransportRules):
        return []
    first = N_COLUMNS * spec.n_agents
    body = state[first : first + 7].astype(float)
    goal = robots_of(state, spec.n_agents)[0, [TX, TY]].astype(float)
    towards = body[4:6] if spec.rules.goal_angle is None else state[first + 7 : first + 9]
    wanted = payload_outline(spec.rules.payload, goal, np.asarray(towards, float))
    now = payload_outline(spec.rules.payload, body[:2], body[4:6])
    return [
        svg_shapes.path(places(wanted), closed=True, class_="wanted"),
        svg_shapes.path(places(now), closed=True, class_="payload"),
    ]


def _target(spec: TaskSpec, at: Point, scale: float) -> Html:
    """The mark of where a robot should be, in its own color."""
    x, y = at
    if isinstance(spec.rules, NavigationRules | WarehouseRules):
        return svg_shapes.disc(at, spec.rules.goal_radius * scale, class_="goal")
    if isinstance(spec.rules, TransportRules):
        return join()
    arm = 0.07 * scale
    cross = [svg_shapes.line((x - arm, y - arm), (x + arm, y + arm))]
    cross.append(svg_shapes.line((x - arm, y + arm), (x + arm, y - arm)))
    return element("g", *cross, class_="slot")
