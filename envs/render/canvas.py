"""A canvas with coordinates in metres: the few shapes that a world needs, drawn by Pillow."""

import math
from copy import copy
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.envs.render.colors import TEXT_COLOR, WHITE, Color, Ink
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.specs.task_spec import Arena
from swarmdata.types import Double

Image = NDArray[np.uint8]  # [H, W, 3]
WALL_WIDTH = 0.1  # m of wall around the arena
_CAPTION_SHARE = 0.055  # height of the caption, as a share of the picture's longer side
_SUPERSAMPLING_FACTOR = 3
_MIN_SIZE = 64


def pillow() -> ModuleType:
    """Returns `PIL.Image`.

    Raises:
        MissingExtraError: Pillow is not installed.
    """
    try:
        import PIL.Image  # noqa: PLC0415  (Pillow is an extra)
    except ImportError as error:
        raise MissingExtraError("pillow", "plots", "drawing a world") from error
    module: ModuleType = PIL.Image
    return module


class Canvas:
    """Draws shapes in metres, in the arena's frame (x right, y up), with supersampling.

    An ink with an opacity blends with what is below it.
    """

    def __init__(self, arena: Arena, size: int, *, has_caption: bool) -> None:
        if size < _MIN_SIZE:
            raise SchemaError(f"size is {size} pixels, expected at least {_MIN_SIZE}.")
        width, height = arena.width + 2 * WALL_WIDTH, arena.height + 2 * WALL_WIDTH
        pixels = size / max(width, height)  # per m, of the final picture
        self.scale = pixels * _SUPERSAMPLING_FACTOR
        self._left, self._top = -width / 2, height / 2
        self._height = round(height * pixels) * _SUPERSAMPLING_FACTOR
        self._caption = round(size * _CAPTION_SHARE) * _SUPERSAMPLING_FACTOR if has_caption else 0
        shape = round(width * pixels) * _SUPERSAMPLING_FACTOR, self._height + self._caption
        self._use(pillow().new("RGB", shape, WHITE))

    def _use(self, image: Any) -> None:
        import PIL.ImageDraw  # noqa: PLC0415  (Pillow is an extra; `pillow` has checked it)

        self._image, self._pen = image, PIL.ImageDraw.Draw(image, "RGBA")
        self._filler = PIL.ImageDraw.Draw(image)  # ten times as fast: it does not blend

    def copy(self) -> "Canvas":
        twin = copy(self)
        twin._use(self._image.copy())
        return twin

    def finish(self) -> Any:
        """Returns the Pillow image at its final size."""
        return self._image.reduce(_SUPERSAMPLING_FACTOR)

    def thickness(self, width: float) -> int:
        """Returns the width in pixels of a line `width` metres wide, at least one final pixel."""
        return max(_SUPERSAMPLING_FACTOR, round(width * self.scale))

    def point(self, x: float, y: float) -> tuple[float, float]:
        return (x - self._left) * self.scale, (self._top - y) * self.scale

    def _points(self, places: Double) -> list[tuple[float, float]]:
        return [self.point(x, y) for x, y in places.tolist()]

    def disc(
        self,
        x: float,
        y: float,
        radius: float,
        fill: Color | Ink | None,
        *,
        outline: Color | Ink | None = None,
        width: float = 0.0,
    ) -> None:
        """Draws a disc, and a ring if there is an outline, `width` metres wide inside `radius`."""
        px, py = self.point(x, y)
        r = radius * self.scale
        line = self.thickness(width) if outline else 0
        self._pen.ellipse((px - r, py - r, px + r, py + r), fill=fill, outline=outline, width=line)

    def polygon(self, corners: Double, fill: Color | Ink) -> None:
        """Draws a filled polygon, [K, 2]."""
        self._pen.polygon(self._points(corners), fill=fill)

    def line(self, places: Double, color: Color | Ink, width: float) -> None:
        """Draws a polyline, [K, 2]."""
        self._pen.line(self._points(places), fill=color, width=self.thickness(width))

    def loop(self, corners: Double, color: Color | Ink, width: float) -> None:
        """Draws the outline of a polygon, [K, 2], with round corners, in an opaque color."""
        closed = np.vstack([corners, corners[:1]])
        self.line(closed, color, width)
        for x, y in corners.tolist():
            self.disc(x, y, self.thickness(width) / self.scale / 2, color)

    def ribbon(self, places: Double, color: Color | Ink, width: float) -> None:
        """Draws a smooth curve, [K, 2], as one polygon, so that a translucent ink is even."""
        ahead = np.gradient(places, axis=0)
        ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-12)[:, None]
        side = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        half = self.thickness(width) / self.scale / 2
        self.polygon(np.vstack([places + half * side, (places - half * side)[::-1]]), color)

    def dashes(self, places: Double, color: Color | Ink, width: float, dash: float) -> None:
        """Draws a dashed curve, [K, 2]; dashes and gaps are `dash` metres long."""
        steps = np.hypot(*np.diff(places, axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        for start in np.arange(0.0, along[-1], 2 * dash):
            at = np.linspace(start, min(start + dash, along[-1]), 4)
            curve = [np.interp(at, along, places[:, axis]) for axis in (0, 1)]
            self.ribbon(np.stack(curve, axis=1), color, width)

    def rectangle(self, x0: float, y0: float, x1: float, y1: float, fill: Color) -> None:
        """Fills an axis-aligned rectangle between its lower left and upper right corners."""
        self._filler.rectangle((*self.point(x0, y1), *self.point(x1, y0)), fill=fill)

    def write_caption(self, text: str) -> None:
        """Writes one line of text below the arena, in a smaller font if it would not fit."""
        import PIL.ImageFont  # noqa: PLC0415  (Pillow is an extra; `pillow` has checked it)

        room = self._image.width - 0.8 * self._caption
        pixels = 0.62 * self._caption
        font = PIL.ImageFont.load_default(size=pixels)
        length = font.getlength(text)
        if length > room:
            font = PIL.ImageFont.load_default(size=math.floor(pixels * room / length))
        middle = self._height + self._caption / 2
        self._pen.text((0.4 * self._caption, middle), text, fill=TEXT_COLOR, font=font, anchor="lm")
