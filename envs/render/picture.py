"""The picture of a state that cards, pages, notebooks and videos use."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swarmdata.envs.physics.public_backend import bars
from swarmdata.envs.render.canvas import WALL_WIDTH, Canvas, Image, pillow
from swarmdata.envs.render.colors import (
    CONTACT_COLOR,
    DROPPED_COLOR,
    FLOOR_COLOR,
    GRID_COLOR,
    OBSTACLE_COLOR,
    PAYLOAD_COLOR,
    PAYLOAD_EDGE_COLOR,
    TEXT_COLOR,
    UNASSIGNED_COLOR,
    WHITE,
    Color,
    ink,
    robot_color,
    tint,
)
from swarmdata.envs.render.drawn_scene import Messages, Scan, Scene, build_scan, build_scene
from swarmdata.envs.render.targets import (
    Target,
    direction_of,
    payload_outline,
    targets_of,
    wanted_outline,
)
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.specs.state_layout import TX, TY, UX, UY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Counts, Double, Float


def draw(
    spec: TaskSpec,
    layout: Float,
    state: Float,
    *,
    trails: Float | None = None,
    events: Counts | None = None,
    scan: Float | None = None,
    scan_range: float | None = None,
    focus: int | None = None,
    messages: Messages | None = None,
    caption: str | None = None,
    size: int = 512,
) -> Image:
    """Returns a picture of one state, uint8 [H, W, 3]; the arena's longer side spans `size` pixels.

    Args:
        spec: the task; it defines the arena, the robots, and the meaning of targets.
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].
        state: robots, movable bodies and the task's own numbers, as in `state_layout`, [S].
        trails: earlier states, oldest first, whose positions are drawn as fading lines, [K, S].
        events: safety events of the step that led to the state, columns `types.EVENTS`, [N, 4].
        scan: lidar distances as shares of the range, 1 = nothing, first ray along the heading, then
            evenly counter-clockwise, [N, K].
        scan_range: range of the rays, m; by default that of the spec's lidar.
        focus: the only robot whose scan is drawn; all by default.
        messages: messages delivered in this step, and messages attempted (or None); both [N, N],
            receivers first, then senders.
        caption: one line below the arena.
        size: pixels, at least 64.

    Raises:
        SchemaError: an array or `size` does not fit the spec.
        MissingExtraError: Pillow is not installed.
    """
    rays = None if scan is None else build_scan(spec, scan, scan_range, focus)
    scene = build_scene(
        spec, layout, state, trails=trails, events=events, scan=rays, messages=messages
    )
    canvas = backdrop(scene, size, has_caption=caption is not None)
    return np.asarray(paint(canvas, scene, caption))


def save_png(image: Image, file: Path | BinaryIO) -> None:
    """Writes a picture as PNG to a path or an open binary file."""
    pillow().fromarray(image).save(file, format="PNG", optimize=True)


def backdrop(scene: Scene, size: int, *, has_caption: bool) -> Canvas:
    """Draws floor, walls and obstacles, which are the same for every step of an episode."""
    arena = scene.spec.arena
    canvas = Canvas(arena, size, has_caption=has_caption)
    x, y = arena.width / 2, arena.height / 2
    canvas.rectangle(
        -x - WALL_WIDTH, -y - WALL_WIDTH, x + WALL_WIDTH, y + WALL_WIDTH, OBSTACLE_COLOR
    )
    canvas.rectangle(-x, -y, x, y, FLOOR_COLOR)
    for k in range(-int(x), int(x) + 1):
        canvas.line(np.array([(k, -y), (k, y)]), GRID_COLOR, 0.0)
    for k in range(-int(y), int(y) + 1):
        canvas.line(np.array([(-x, k), (x, k)]), GRID_COLOR, 0.0)
    _draw_obstacles(canvas, scene.layout)
    return canvas


def _draw_obstacles(canvas: Canvas, layout: Float) -> None:
    corners = np.empty((3, 4, 2))
    for row in layout:
        if row[0] == CIRCLE:
            canvas.disc(float(row[1]), float(row[2]), float(row[5]), OBSTACLE_COLOR)
        else:
            for bar in corners[: bars(row, corners)]:
                canvas.polygon(bar, OBSTACLE_COLOR)


def paint(canvas: Canvas, scene: Scene, caption: str | None) -> Any:
    """Draws what moves onto a backdrop and returns the Pillow image at its final size."""
    draw_targets(canvas, scene)
    draw_trails(canvas, scene)
    if scene.scan is not None:
        draw_fans(canvas, scene, scene.scan)
        _draw_obstacles(canvas, scene.layout)  # again, so that fans do not shade the obstacles
    draw_bodies(canvas, scene)
    if scene.scan is not None:
        draw_hits(canvas, scene, scene.scan)
    draw_messages(canvas, scene)
    draw_robots(canvas, scene)
    if caption is not None:
        canvas.write_caption(caption)
    return canvas.finish()


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
    """Draws a role's mark along the heading; a holonomic robot at rest gets a dot instead."""
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
    ux, uy = heading
    ahead, left = shape[:, 0], shape[:, 1]
    return place + np.stack([ahead * ux - left * uy, ahead * uy + left * ux], axis=1)


_MAX_LINKS_PER_ROBOT = 5
"""Links per robot above which only their ends at the receiver are drawn, since whole links would
hide each other (partial edge drawing: Bruckdorfer and Kaufmann, "Mad at Edge Crossings? Break the
Edges!", 2012)."""

_STUB_LENGTH = 0.3  # m, length of a link's end where links are crowded
_LINK_SAGITTA_SHARE = 0.13  # of a link's length; each direction bends to its own left


def draw_fans(canvas: Canvas, scene: Scene, scan: Scan) -> None:
    """Draws pale fans over the area that the rays of a lidar cover, and the rays as thin lines."""
    n_fans = len(scan.shown)  # one fan is strong; more than four are paler the more there are
    strength = 1.8 if n_fans == 1 else min(1.0, 2.0 / math.sqrt(n_fans))
    for i in scan.shown:
        fan = _swept(scene, scan, i)
        if len(fan) > 1:  # a single ray that hits something covers no area
            canvas.polygon(fan, ink(robot_color(i), 0.1 * strength**1.5))
    for i in scan.shown:
        for end in _ends(scene, scan, i):
            ray = np.array([scene.robots[i, [X, Y]], end])
            canvas.line(ray, ink(robot_color(i), 0.3 * strength), 0.008)


def draw_hits(canvas: Canvas, scene: Scene, scan: Scan) -> None:
    """Draws a dot where each ray hits something."""
    for i in scan.shown:
        for x, y in _ends(scene, scan, i)[scan.is_hit[i]].tolist():
            canvas.disc(x, y, 0.026, robot_color(i))


def _angles(scene: Scene, i: int, n: int) -> Double:
    """Returns the directions of `n` rays of robot `i`, rad, [n]."""
    first = math.atan2(scene.robots[i, UY], scene.robots[i, UX])
    return first + np.linspace(0.0, 2 * np.pi, n, endpoint=False)


def _polar(angles: Double, distances: Double) -> Double:
    return np.stack([distances * np.cos(angles), distances * np.sin(angles)], axis=1)


def _ends(scene: Scene, scan: Scan, i: int) -> Double:
    """Returns the ends of the rays of robot `i`, [K, 2]."""
    distances = scan.distances[i]
    return scene.robots[i, [X, Y]] + _polar(_angles(scene, i, len(distances)), distances)


def _swept(scene: Scene, scan: Scan, i: int) -> Double:
    """Returns the outline of the area that rays cover: straight between hits, an arc elsewhere."""
    n, fine = len(scan.distances[i]), 6
    angles = _angles(scene, i, n * fine)
    distances = np.repeat(scan.distances[i], fine)
    is_free = ~(scan.is_hit[i] | np.roll(scan.is_hit[i], -1))  # to the next ray
    is_kept = np.repeat(is_free, fine)
    is_kept[::fine] = True
    return scene.robots[i, [X, Y]] + _polar(angles, distances)[is_kept]


def draw_messages(canvas: Canvas, scene: Scene) -> None:
    """Draws arrows in the sender's color, and dashed lines with a cross for dropped messages."""
    n_links = int(scene.delivered.sum() + scene.dropped.sum())
    is_crowded = n_links > _MAX_LINKS_PER_ROBOT * len(scene.robots)
    for receiver, sender in np.argwhere(scene.dropped).tolist():
        curve = _link(scene, sender, receiver, is_crowded)
        curve = curve if is_crowded else curve[: len(curve) * 3 // 5]
        canvas.dashes(curve, ink(DROPPED_COLOR, 0.9), 0.016, 0.04)
        place = curve[len(curve) // 2] if is_crowded else curve[-1]
        for arm in ((0.035, 0.035), (0.035, -0.035)):
            canvas.line(np.array([place - arm, place + arm]), DROPPED_COLOR, 0.018)
    for receiver, sender in np.argwhere(scene.delivered).tolist():
        color = robot_color(sender)
        curve = _link(scene, sender, receiver, is_crowded)
        canvas.ribbon(curve, ink(color, 0.75), 0.014)
        _arrow(canvas, curve, ink(color, 1.0))


def _link(scene: Scene, sender: int, receiver: int, is_crowded: bool) -> Double:
    """Returns a curve from rim to rim, or only a line's end at the receiver if crowded, [K, 2]."""
    start, end = scene.robots[sender, [X, Y]], scene.robots[receiver, [X, Y]]
    chord = end - start
    length = float(np.hypot(*chord))
    if length == 0.0:
        return np.repeat(start[None], 3, axis=0)
    bend = 0.0 if is_crowded else 2 * _LINK_SAGITTA_SHARE
    control = (start + end) / 2 + bend * np.array([-chord[1], chord[0]])
    first = min(0.45, 1.25 * scene.radii[sender] / length)
    last = max(0.55, 1.0 - 1.3 * scene.radii[receiver] / length)
    if is_crowded:
        first = max(first, last - _STUB_LENGTH / length)
    t = np.linspace(first, last, 24)[:, None]
    return (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end


def _arrow(canvas: Canvas, curve: Double, color: tuple[int, int, int, int]) -> None:
    tip, ahead = curve[-1], curve[-1] - curve[-2]
    length = float(np.hypot(*ahead))
    if length == 0.0:
        return
    ahead = ahead / length
    side = np.array([-ahead[1], ahead[0]])
    back = tip - 0.075 * ahead
    canvas.polygon(np.array([tip, back + 0.035 * side, back - 0.035 * side]), color)


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
    """Draws the payload's outline at its goal, and the disc that its centre must reach."""
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
