"""Pictures and animations that a notebook displays."""

import base64
import io
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from swarmdata.envs.render.picture import draw, save_png
from swarmdata.envs.render.video import animate
from swarmdata.runtime.atomic import write_file
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode, Float


@dataclass(frozen=True, repr=False)
class Picture:
    """An encoded image, which a notebook shows as the last value of a cell."""

    data: bytes
    format: Literal["png", "gif"]

    def __repr__(self) -> str:
        """Returns format and size instead of bytes."""
        return f"Picture({self.format}, {len(self.data)} bytes)"

    def _repr_png_(self) -> bytes | None:
        return self.data if self.format == "png" else None

    def _repr_html_(self) -> str:
        text = base64.b64encode(self.data).decode("ascii")
        return f'<img alt="a world" src="data:image/{self.format};base64,{text}">'

    def save(self, path: Path) -> None:
        """Writes the encoded image to a file."""
        write_file(Path(path), self.data)


def show(spec: TaskSpec, layout: Float, state: Float, **options: Any) -> Picture:
    """Draws one state for a notebook; arguments and errors are those of `draw`."""
    buffer = io.BytesIO()
    save_png(draw(spec, layout, state, **options), buffer)
    return Picture(buffer.getvalue(), "png")


def play(episode: Episode, spec: TaskSpec, **options: Any) -> Picture:
    """Animates an episode for a notebook; arguments and errors are those of `animate`."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "episode.gif"
        animate(episode, spec, path, **options)
        return Picture(path.read_bytes(), "gif")
