"""Animations of an episode: a GIF through Pillow, or an MP4 through ffmpeg; both in notebooks."""

import base64
import io
import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any, Literal

import numpy as np

from swarmdata.envs.render.canvas import pillow
from swarmdata.envs.render.colors import PURE_COLORS, robot_color, tint
from swarmdata.envs.render.drawn_scene import Scene, build_scan, build_scene
from swarmdata.envs.render.picture import backdrop, draw, paint, save_png
from swarmdata.errors import ProgramError, SchemaError
from swarmdata.runtime.atomic import staged, write_file
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Episode, Float

VIDEO_SUFFIXES = (".gif", ".mp4")

_REST_SECONDS = 2.0  # s on the last state
_STILL = 255  # index of pixels that stay as they are, which the palette does not use


def animate(
    episode: Episode,
    spec: TaskSpec,
    path: Path,
    *,
    size: int = 384,
    stride: int = 1,
    trail_steps: int = 30,
    scans: Float | None = None,
    scan_range: float | None = None,
    focus: int | None = None,
    attempted: Bool | None = None,
    has_messages: bool = True,
) -> None:
    """Writes an animation that plays an episode in real time and shows the last state for 2 s.

    Args:
        episode: the episode to show.
        spec: the spec of its task.
        path: a `.gif` or `.mp4` file; the latter needs the program ffmpeg.
        size: pixels of the arena's longer side.
        stride: control steps between pictures; contacts between two pictures are shown.
        trail_steps: length of the trails, in control steps.
        scans: lidar distances as `draw` takes them, [T+1, N, K].
        scan_range: range of the rays, m; by default that of the spec's lidar.
        focus: the only robot whose scan is drawn; all by default.
        attempted: links over which messages were sent, to show losses, [T+1, N, N].
        has_messages: whether the messages of an episode with a channel are drawn.

    Raises:
        SchemaError: the episode does not fit the spec, or `path` is neither `.gif` nor `.mp4`.
        MissingExtraError: Pillow is not installed.
        ProgramError: ffmpeg is needed but not installed, or it failed.
    """
    path = Path(path)
    if path.suffix.lower() not in VIDEO_SUFFIXES or stride < 1 or trail_steps < 0:
        raise SchemaError(
            f"got path {str(path)!r}, stride {stride}, trail_steps {trail_steps}; "
            "expected a '.gif' or '.mp4', a stride of at least 1 and trail_steps of at least 0."
        )
    _check_rows(len(episode) + 1, scans=scans, attempted=attempted)
    has_messages &= episode.delivered.shape[-1] > 0

    def scene_at(t: int) -> Scene:
        tried = None if attempted is None else attempted[t]
        return build_scene(
            spec,
            episode.layout,
            episode.states[t],
            trails=episode.states[max(0, t - trail_steps) : t + 1],
            events=episode.events[max(0, t - stride) : t].max(axis=0, initial=0),
            scan=None if scans is None else build_scan(spec, scans[t], scan_range, focus),
            messages=(episode.delivered[t], tried) if has_messages else None,
        )

    frames, seconds = _frames(episode, spec, scene_at, size, stride), spec.control_dt * stride
    if path.suffix.lower() == ".gif":
        write_gif(list(frames), path, seconds)
    else:
        write_mp4(frames, path, seconds)


def _check_rows(n_states: int, **arrays: Float | Bool | None) -> None:
    for name, array in arrays.items():
        if array is not None and len(array) != n_states:
            raise SchemaError(
                f"{name} has {len(array)} rows, expected {n_states}: one for each state."
            )


def _frames(
    episode: Episode, spec: TaskSpec, scene_at: Callable[[int], Scene], size: int, stride: int
) -> Iterator[Any]:
    """Yields Pillow images of every `stride`-th state and the last one, all of the same size."""
    blank = None
    for t in sorted({*range(0, len(episode), stride), len(episode)}):
        scene = scene_at(t)
        blank = blank or backdrop(scene, size, has_caption=True)
        text = f"{t * spec.control_dt:4.1f} s    step {t} of {spec.horizon}"
        if t == len(episode):
            text += f"    {_outcome(episode)}"
        yield paint(blank.copy(), scene, text)


def _outcome(episode: Episode) -> str:
    if not episode.success:
        return "failed" if episode.terminations[-1] else "out of time"
    return "solved, with contact" if episode.events.any() else "solved, nothing touched"


def write_gif(frames: list[Any], path: Path, seconds: float) -> None:
    """Writes Pillow images, each shown for `seconds`, as a GIF.

    All frames share one palette without dithering, and pixels that stay as they are are
    transparent, so that still parts take no space.
    """
    palette, dither = _palette(frames), pillow().Dither.NONE
    indexed = [frame.quantize(palette=palette, dither=dither) for frame in frames]
    pixels = [np.asarray(image) for image in indexed]
    changed = [np.where(b == a, _STILL, b).astype(np.uint8) for a, b in pairwise(pixels)]
    later = [pillow().fromarray(each) for each in changed]
    for image in later:
        image.putpalette(palette.getpalette())
    durations = [round(1000 * seconds)] * (len(frames) - 1) + [round(1000 * _REST_SECONDS)]
    indexed[0].save(
        path, save_all=True, append_images=later, duration=durations, loop=0, optimize=False,
        transparency=_STILL, disposal=1,
    )  # fmt: skip


def _palette(frames: list[Any]) -> Any:
    """Returns the pure colors, so that rare contacts stay red, and common ones of three frames."""
    pil = pillow()
    robots = (tint(robot_color(i), strength) for i in range(16) for strength in (1.0, 0.5))
    pure = [*PURE_COLORS, *robots]
    shown = (frames[0], frames[len(frames) // 2], frames[-1])
    sample = pil.new("RGB", (shown[0].width, 3 * shown[0].height))
    for k, frame in enumerate(shown):
        sample.paste(frame, (0, k * frame.height))
    n_rest = 160 - len(pure)
    common = sample.quantize(colors=n_rest, method=pil.Quantize.MEDIANCUT).getpalette()
    palette = pil.new("P", (1, 1))
    palette.putpalette([value for color in pure for value in color] + common[: 3 * n_rest])
    return palette


def write_mp4(frames: Iterable[Any], path: Path, seconds: float) -> None:
    """Writes Pillow images of one size, each shown for `seconds`, as H.264 in an MP4.

    Raises:
        ProgramError: ffmpeg is not on the PATH, or it failed; then no file is left.
    """
    program = shutil.which("ffmpeg")
    if program is None:
        raise ProgramError(
            f"writing {path} needs the program ffmpeg, which is not on the PATH. Install it "
            "(apt install ffmpeg, brew install ffmpeg), or write a '.gif'."
        )
    images = iter(frames)
    first = next(images)
    rate = Fraction(1 / seconds).limit_denominator(1000)
    command = [program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{first.width}x{first.height}", "-r", str(rate), "-i", "-", "-an"]
    command += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-c:v", "libx264"]
    command += ["-crf", "18", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with staged(path) as target:
        _feed([*command, str(target)], _raw(first, images, round(_REST_SECONDS / seconds)), path)


def _raw(first: Any, images: Iterator[Any], n_rest: int) -> Iterator[bytes]:
    """Yields the pixels of every image, and those of the last one `n_rest` times more."""
    pixels = np.asarray(first).tobytes()
    yield pixels
    for image in images:
        pixels = np.asarray(image).tobytes()
        yield pixels
    for _ in range(n_rest):
        yield pixels


def _feed(command: list[str], chunks: Iterable[bytes], path: Path) -> None:
    with TemporaryFile() as log:  # a pipe would fill up and stop both
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=log) as process:
            assert process.stdin is not None
            with suppress(BrokenPipeError):  # ffmpeg ended early; its status and log say why
                for chunk in chunks:
                    process.stdin.write(chunk)
                process.stdin.close()
        if process.returncode != 0:
            log.seek(0)
            reason = log.read().decode(errors="replace").strip() or "it gave no reason"
            raise ProgramError(
                f"ffmpeg could not write {path}, status {process.returncode}: {reason}. It must "
                "have the encoder libx264."
            )


@dataclass(frozen=True, repr=False)
class Picture:
    """An encoded image, which a notebook shows as the last value of a cell."""

    data: bytes
    format: Literal["png", "gif"]

    def __repr__(self) -> str:
        return f"Picture({self.format}, {len(self.data)} bytes)"

    def _repr_png_(self) -> bytes | None:
        return self.data if self.format == "png" else None

    def _repr_html_(self) -> str:
        text = base64.b64encode(self.data).decode("ascii")
        return f'<img alt="a world" src="data:image/{self.format};base64,{text}">'

    def save(self, path: Path) -> None:
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
