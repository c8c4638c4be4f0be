"""One episode as a GIF, an MP4 or a PNG, with what the robots sensed and what they told each other.

Which messages were lost is not recorded. It is found by observing the episode again over a channel
that loses nothing on air: what arrives there and did not arrive here was lost.
"""

from functools import partial
from pathlib import Path

from swarmdata.datasets.reobservation import attempted_links
from swarmdata.envs.render import animate, draw, save_png
from swarmdata.envs.render.video import VIDEO_SUFFIXES
from swarmdata.errors import SchemaError
from swarmdata.perception.observer import features_of
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_task
from swarmdata.runtime.atomic import staged
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import END_REASONS, Episode

CLIPS = (*VIDEO_SUFFIXES, ".png")
"""Endings of the files that can be written."""


def check_clip(out: Path) -> None:
    """Refuses a file that `write_clip` cannot write, before an episode is played.

    Raises:
        SchemaError: naming the endings there are.
    """
    if out.suffix.lower() not in CLIPS:
        raise SchemaError(f"cannot draw to {str(out)!r}, expected a file that ends in {CLIPS}.")


def write_clip(
    episode: Episode, spec: TaskSpec, out: Path, *, size: int = 384, stride: int = 2
) -> None:
    """Draws an episode: an animation, or as PNG its last state with the whole paths.

    Lidar rays are drawn where the spec observes by lidar, messages where robots talk.

    Args:
        episode: what to show; its observations must be those of the spec's models.
        spec: what made it.
        out: a `.gif`, `.mp4` or `.png` file; its folder is made if absent.
        size: pixels of the arena's longer side.
        stride: control steps between two pictures of an animation.

    Raises:
        SchemaError: another kind of file, or an episode that does not fit the spec.
        MissingExtraError: Pillow is not installed.
        ProgramError: an MP4 needs ffmpeg.
        DiskFullError: no space was left.
    """
    check_clip(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    scans = scan_of(features_of(make_task(spec)), episode.observations)
    attempted = attempted_links(episode, spec)
    if out.suffix.lower() != ".png":
        play = partial(animate, episode, spec, scans=scans, attempted=attempted)
        with staged(out) as target:
            play(target, size=size, stride=stride)
        return
    last = len(episode)
    image = draw(
        spec,
        episode.layout,
        episode.states[last],
        trails=episode.states,
        events=episode.events[last - 1],
        scan=None if scans is None else scans[last],
        messages=None if attempted is None else (episode.delivered[last], attempted[last]),
        size=size,
        caption=f"{last * spec.control_dt:.1f} s    {END_REASONS[episode.end_reason]}",
    )
    with staged(out) as target:
        save_png(image, target)
