"""Draws a world: the one picture of a state that cards, pages and videos use.

Robots are discs in their own colors with a bright wedge that points where they drive; a goal is a
ring of its robot's color, filled while the robot is in it; a red halo marks a contact.
"""

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.envs.pymunk_space import bars
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.geometry import CIRCLE
from swarmdata.spec import TaskSpec
from swarmdata.types import Counts, Double, Episode, Float

Color = tuple[int, int, int]
Image = NDArray[np.uint8]  # [H, W, 3]

ROBOT_COLORS: tuple[Color, ...] = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (120, 94, 60),
)
"""From Okabe and Ito, "Color Universal Design", 2008; red is kept for contacts."""

_FLOOR: Color = (252, 252, 250)
_GRID: Color = (238, 239, 238)
_SOLID: Color = (84, 93, 106)
_INK: Color = (45, 51, 60)
_CONTACT: Color = (213, 34, 34)
_WALL_SHOWN = 0.1  # m of wall around the arena
_CAPTION = 0.055  # height of the caption, as a share of the picture's longer side
_SUPERSAMPLING = 3
_MOVING = 0.02  # m/s; below this a heading is noise


@dataclass(frozen=True, slots=True)
class _View:
    """From metres to pixels of the supersampled picture."""

    scale: float  # px per m
    left: float  # m
    top: float  # m
    width: int  # px
    height: int  # px, without the caption
    caption: int  # px

    def point(self, x: float, y: float) -> tuple[float, float]:
        return (x - self.left) * self.scale, (self.top - y) * self.scale

    def disc(self, x: float, y: float, radius: float) -> tuple[float, float, float, float]:
        """Bounding box of a circle."""
        px, py = self.point(x, y)
        r = radius * self.scale
        return px - r, py - r, px + r, py + r


def draw(
    spec: TaskSpec,
    layout: Float,
    state: Float,
    *,
    trails: Float | None = None,
    events: Counts | None = None,
    caption: str | None = None,
    size: int = 512,
) -> Image:
    """Returns a picture of one state, uint8 [H, W, 3]; the arena's longer side spans `size` pixels.

    Args:
        spec: the problem; gives the arena, the robots' sizes and the goal radius.
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].
        state: x, y, vx, vy, goal_x, goal_y of each robot, m and m/s, [6 N].
        trails: earlier states, oldest first, whose positions become fading lines, [K, 6 N].
        events: safety events of the step that led here, columns `types.EVENTS`, [N, 4].
        caption: one line below the arena.
        size: pixels, at least 64.

    Raises:
        SchemaError: an array or `size` does not fit the spec.
        MissingExtraError: Pillow is not installed.
    """
    view = _view(spec, size, has_caption=caption is not None)
    image = _backdrop(spec, view, layout)
    return np.asarray(_paint(image, spec, view, state, trails, events, caption))


def animate(
    episode: Episode,
    spec: TaskSpec,
    path: Path,
    *,
    size: int = 384,
    stride: int = 2,
    trail_steps: int = 30,
) -> None:
    """Writes an episode as a GIF that plays in real time and rests two seconds on its last state.

    Args:
        episode: what to show.
        spec: the spec that made it.
        path: the `.gif` file.
        size: pixels of the arena's longer side.
        stride: control steps between two pictures; contacts between them are shown.
        trail_steps: length of the trails, in control steps.

    Raises:
        SchemaError: the episode does not fit the spec, or `path` is not a `.gif`.
        MissingExtraError: Pillow is not installed.
    """
    if Path(path).suffix.lower() != ".gif" or stride < 1 or trail_steps < 0:
        raise SchemaError(
            f"got path {str(path)!r}, stride {stride}, trail_steps {trail_steps}; "
            "expected a '.gif', a stride of at least 1 and trail_steps of at least 0."
        )
    times = sorted({*range(0, len(episode), stride), len(episode)})
    view = _view(spec, size, has_caption=True)
    backdrop = _backdrop(spec, view, episode.layout)
    frames = []
    for t in times:
        recent = episode.events[max(0, t - stride) : t].max(axis=0, initial=0)
        trail = episode.states[max(0, t - trail_steps) : t + 1]
        text = f"{t * spec.control_dt:4.1f} s    step {t} of {spec.horizon}"
        if t == len(episode):
            text += f"    {_outcome(episode)}"
        image = backdrop.copy()
        frames.append(_paint(image, spec, view, episode.states[t], trail, recent, text))
    _write_gif(frames, Path(path), round(1000 * spec.control_dt * stride))


def _outcome(episode: Episode) -> str:
    if not episode.success:
        return "failed" if episode.terminations[-1] else "out of time"
    return "solved, with contact" if episode.events.any() else "solved, nothing touched"


def _write_gif(frames: list[Any], path: Path, frame_ms: int) -> None:
    """One palette for all frames, without dither: what does not move costs no bytes."""
    pil = _pillow()
    sample = pil.new("RGB", (frames[0].width, 3 * frames[0].height))
    for k, frame in enumerate((frames[0], frames[len(frames) // 2], frames[-1])):
        sample.paste(frame, (0, k * frame.height))
    palette = sample.quantize(colors=128, method=pil.Quantize.MEDIANCUT)
    indexed = [frame.quantize(palette=palette, dither=pil.Dither.NONE) for frame in frames]
    durations = [frame_ms] * (len(frames) - 1) + [2000]
    indexed[0].save(
        path, save_all=True, append_images=indexed[1:], duration=durations, loop=0, optimize=False
    )


def _pillow() -> ModuleType:
    try:
        import PIL.Image  # noqa: PLC0415  (Pillow is an extra)
    except ImportError as error:
        raise MissingExtraError("pillow", "plots", "drawing a world") from error
    module: ModuleType = PIL.Image
    return module


def _pen(image: Any) -> Any:
    import PIL.ImageDraw  # noqa: PLC0415  (Pillow is an extra; `_pillow` has checked it)

    return PIL.ImageDraw.Draw(image)


def _view(spec: TaskSpec, size: int, *, has_caption: bool) -> _View:
    if size < 64:
        raise SchemaError(f"size is {size} pixels, expected at least 64.")
    width, height = spec.arena.width + 2 * _WALL_SHOWN, spec.arena.height + 2 * _WALL_SHOWN
    pixels = size / max(width, height)  # per m, of the final picture
    return _View(
        scale=pixels * _SUPERSAMPLING,
        left=-width / 2,
        top=height / 2,
        width=round(width * pixels) * _SUPERSAMPLING,
        height=round(height * pixels) * _SUPERSAMPLING,
        caption=round(size * _CAPTION) * _SUPERSAMPLING if has_caption else 0,
    )


def _backdrop(spec: TaskSpec, view: _View, layout: Float) -> Any:
    """Floor, walls and obstacles; the same for every step of an episode."""
    if layout.ndim != 2 or layout.shape[1] != 8:
        raise SchemaError(f"layout is {list(layout.shape)}, expected [M, 8] (geometry.OBSTACLE).")
    image = _pillow().new("RGB", (view.width, view.height + view.caption), (255, 255, 255))
    pen = _pen(image)
    pen.rectangle((0, 0, view.width, view.height), fill=_SOLID)
    half_x, half_y = spec.arena.width / 2, spec.arena.height / 2
    pen.rectangle((*view.point(-half_x, half_y), *view.point(half_x, -half_y)), fill=_FLOOR)
    hair = _SUPERSAMPLING
    for k in range(-int(half_x), int(half_x) + 1):
        pen.line((*view.point(k, half_y), *view.point(k, -half_y)), fill=_GRID, width=hair)
    for k in range(-int(half_y), int(half_y) + 1):
        pen.line((*view.point(-half_x, k), *view.point(half_x, k)), fill=_GRID, width=hair)
    corners = np.empty((3, 4, 2))
    for row in layout:
        if row[0] == CIRCLE:
            pen.ellipse(view.disc(float(row[1]), float(row[2]), float(row[5])), fill=_SOLID)
        else:
            n_bars = bars(row, corners)
            for bar in corners[:n_bars]:
                pen.polygon([view.point(float(x), float(y)) for x, y in bar], fill=_SOLID)
    return image


def _paint(
    image: Any,
    spec: TaskSpec,
    view: _View,
    state: Float,
    trails: Float | None,
    events: Counts | None,
    caption: str | None,
) -> Any:
    """Draws what moves onto the backdrop and returns the picture at its final size."""
    robots = _per_robot(state, spec)
    pen = _pen(image)
    for i, row in enumerate(robots):
        _goal(pen, view, row, spec.termination.goal_radius, _color(i))
    if trails is not None and len(trails) > 1:
        for i, positions in enumerate(np.moveaxis(_per_robot(trails, spec)[..., :2], 1, 0)):
            _trail(pen, view, positions, _color(i))
    radii = np.array([robot.radius for robot in spec.robots])
    touching = np.zeros(len(robots), np.bool_) if events is None else events.any(axis=1)
    for row, radius in zip(robots[touching], radii[touching], strict=True):  # below all robots
        pen.ellipse(view.disc(row[0], row[1], 1.45 * radius), fill=_CONTACT)
    for i, row in enumerate(robots):
        _robot(pen, view, row, radii[i], _color(i))
    if caption is not None:
        _write_caption(pen, view, caption)
    return image.reduce(_SUPERSAMPLING)


def _per_robot(states: Float, spec: TaskSpec) -> Double:
    """Splits [..., 6 N] into [..., N, 6]."""
    if states.shape[-1] != 6 * spec.n_agents:
        raise SchemaError(
            f"states are {list(states.shape)}, expected [..., {6 * spec.n_agents}] for "
            f"{spec.n_agents} robots. Pass the spec that made them."
        )
    return states.astype(np.float64).reshape(*states.shape[:-1], spec.n_agents, 6)


def _color(i: int) -> Color:
    return ROBOT_COLORS[i % len(ROBOT_COLORS)]


def _tint(color: Color, strength: float) -> Color:
    """Mixes a color with the floor: 0 is the floor, 1 the color."""
    r, g, b = (round(f + strength * (c - f)) for c, f in zip(color, _FLOOR, strict=True))
    return r, g, b


def _goal(pen: Any, view: _View, row: Double, radius: float, color: Color) -> None:
    x, y, goal_x, goal_y = row[0], row[1], row[4], row[5]
    is_reached = (goal_x - x) ** 2 + (goal_y - y) ** 2 <= radius**2
    fill = _tint(color, 0.5 if is_reached else 0.1)
    line = max(1, round(0.022 * view.scale))
    pen.ellipse(view.disc(goal_x, goal_y, radius), fill=fill, outline=color, width=line)
    if not is_reached:
        pen.ellipse(view.disc(goal_x, goal_y, 0.025), fill=color)


def _trail(pen: Any, view: _View, positions: Double, color: Color) -> None:
    """A line that fades into the past; [K, 2]."""
    width = max(1, round(0.035 * view.scale))
    points = [view.point(float(x), float(y)) for x, y in positions]
    for k in range(1, len(points)):
        shade = _tint(color, 0.12 + 0.5 * k / len(points))
        pen.line((*points[k - 1], *points[k]), fill=shade, width=width)
        px, py = points[k]
        r = width / 2  # round joints
        pen.ellipse((px - r, py - r, px + r, py + r), fill=shade)


def _robot(pen: Any, view: _View, row: Double, radius: float, color: Color) -> None:
    x, y, vx, vy = (float(value) for value in row[:4])
    pen.ellipse(view.disc(x, y, 1.1 * radius), fill=(255, 255, 255))
    pen.ellipse(view.disc(x, y, radius), fill=color)
    speed = float(np.hypot(vx, vy))
    if speed < _MOVING:
        pen.ellipse(view.disc(x, y, 0.22 * radius), fill=(255, 255, 255))
        return
    ux, uy = radius * vx / speed, radius * vy / speed
    wedge = [(0.75, 0.0), (-0.4, 0.5), (-0.15, 0.0), (-0.4, -0.5)]  # ahead, left; in radii
    pen.polygon(
        [view.point(x + a * ux - b * uy, y + a * uy + b * ux) for a, b in wedge],
        fill=(255, 255, 255),
    )


def _write_caption(pen: Any, view: _View, caption: str) -> None:
    import PIL.ImageFont  # noqa: PLC0415  (Pillow is an extra; `_pillow` has checked it)

    font = PIL.ImageFont.load_default(size=0.62 * view.caption)
    middle = view.height + view.caption / 2
    pen.text((0.4 * view.caption, middle), caption, fill=_INK, font=font, anchor="lm")
