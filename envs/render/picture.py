"""The picture of a state that cards, pages, notebooks and videos use.

Robots are discs in their own colors with a bright mark along their heading; `target_marks` draws
their targets; a red halo marks a contact.
"""

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swarmdata.envs.physics.public_backend import bars
from swarmdata.envs.render.canvas import WALL_WIDTH, Canvas, Image, pillow
from swarmdata.envs.render.colors import FLOOR_COLOR, GRID_COLOR, OBSTACLE_COLOR
from swarmdata.envs.render.drawn_scene import Messages, Scene, build_scan, build_scene
from swarmdata.envs.render.movers import draw_bodies, draw_robots, draw_trails
from swarmdata.envs.render.signals import draw_fans, draw_hits, draw_messages
from swarmdata.envs.render.target_marks import draw_targets
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Counts, Float


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
        draw_fans(canvas, scene)
        _draw_obstacles(canvas, scene.layout)  # again, so that fans do not shade the obstacles
    draw_bodies(canvas, scene)
    draw_hits(canvas, scene)
    draw_messages(canvas, scene)
    draw_robots(canvas, scene)
    if caption is not None:
        canvas.write_caption(caption)
    return canvas.finish()
