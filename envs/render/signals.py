"""Draws signals: rays of a lidar, and messages delivered and dropped."""

import math

import numpy as np

from swarmdata.envs.render.canvas import Canvas
from swarmdata.envs.render.colors import DROPPED_COLOR, ink, robot_color
from swarmdata.envs.render.drawn_scene import Scan, Scene
from swarmdata.specs.state_layout import UX, UY, X, Y
from swarmdata.types import Double

_MAX_LINKS_PER_ROBOT = 5
"""Links per robot above which only their ends at the receiver are drawn, since whole links would
hide each other (partial edge drawing: Bruckdorfer and Kaufmann, "Mad at Edge Crossings? Break the
Edges!", 2012)."""

_STUB_LENGTH = 0.3  # m, length of a link's end where links are crowded
_LINK_SAGITTA_SHARE = (
    0.13  # sagitta of a link, as a share of its length; each direction bends to its own left
)


def draw_fans(canvas: Canvas, scene: Scene) -> None:
    """Draws pale fans over the area that the rays of a lidar cover, and the rays as thin lines."""
    scan = scene.scan
    if scan is None:
        return
    n_fans = len(scan.shown)  # one fan is strong; more than four are paler the more there are
    strength = 1.8 if n_fans == 1 else min(1.0, 2.0 / math.sqrt(n_fans))
    for i in scan.shown:
        canvas.polygon(_swept(scene, scan, i), ink(robot_color(i), 0.1 * strength**1.5))
    for i in scan.shown:
        for end in _ends(scene, scan, i):
            ray = np.array([scene.robots[i, [X, Y]], end])
            canvas.line(ray, ink(robot_color(i), 0.3 * strength), 0.008)


def draw_hits(canvas: Canvas, scene: Scene) -> None:
    """Draws a dot where each ray hits something."""
    scan = scene.scan
    if scan is None:
        return
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
