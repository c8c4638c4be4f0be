"""Animations play in real time, end at rest, and say what they lack."""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.render import Picture, animate, draw, play, save_png, show
from swarmdata.envs.render import colors as ink
from swarmdata.errors import ProgramError, SchemaError
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.types import Episode

PIL = pytest.importorskip("PIL.Image")

SPEC = TaskSpec(team=(Role(count=3),), horizon=40, observation=LidarModel())
T, N = 20, 3


def make_episode(*, is_solved: bool = True, has_channel: bool = False) -> Episode:
    """Three robots drive to the right side by side; the first touches something in step 9."""
    states = np.zeros((T + 1, N, 8), np.float32)
    states[..., 0] = np.linspace(-1.5, 0.5, T + 1)[:, None]
    states[..., 1] = states[..., 7] = [-1.0, 0.0, 1.0]
    states[..., 2], states[..., 4], states[..., 6] = 1.0, 1.0, 0.5
    events = np.zeros((T, N, 4), np.uint8)
    events[9, 0, 1] = 1
    links = N if has_channel else 0
    ends = np.arange(T) == T - 1
    return Episode(
        observations=np.zeros((T + 1, N, 1), np.float32),
        states=states.reshape(T + 1, -1),
        actions=np.zeros((T, N, 2), np.float32),
        log_probs=np.zeros((T, N), np.float32),
        rewards=np.zeros((T, N), np.float32),
        terminations=ends & is_solved,
        truncations=ends & (not is_solved),
        events=events,
        sent=np.zeros((T + 1, N, 0), np.float32),
        delivered=np.ones((T + 1, N, links), np.bool_),
        ages=np.zeros((T + 1, N, links), np.uint8),
        layout=np.zeros((0, 8), np.float32),
        seed=1,
        policy=0,
        end_reason=0 if is_solved else 2,
    )


EPISODE = make_episode()


def frames_of(path: Path) -> tuple[list[np.ndarray[Any, Any]], list[int]]:
    """Pictures of a GIF and how long each is shown, ms."""
    frames, durations = [], []
    with PIL.open(path) as gif:
        for frame in range(gif.n_frames):
            gif.seek(frame)
            durations.append(gif.info["duration"])
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    return frames, durations


def test_a_gif_plays_in_real_time_and_shows_the_end(tmp_path: Path) -> None:
    path = tmp_path / "episode.gif"
    animate(EPISODE, SPEC, path, size=256, stride=3)
    frames, durations = frames_of(path)
    assert durations == [300] * 7 + [2000]  # steps 0, 3, ..., 18 and 20
    end = draw(SPEC, EPISODE.layout, EPISODE.states[-1], trails=EPISODE.states, size=256)
    assert np.abs(frames[-1][:256] - end).mean() < 2.0  # the palette's rounding
    assert path.stat().st_size < 100_000


def test_a_contact_between_two_pictures_is_shown_in_pure_red(tmp_path: Path) -> None:
    animate(EPISODE, SPEC, tmp_path / "episode.gif", size=128, stride=6)
    frames, _ = frames_of(tmp_path / "episode.gif")
    red = [int((frame == ink.CONTACT_COLOR).all(axis=-1).sum()) for frame in frames]
    assert [count > 5 for count in red] == [False, False, True, False, False]


def test_messages_and_scans_are_drawn_where_there_are_some(tmp_path: Path) -> None:
    talking, path = make_episode(has_channel=True), tmp_path / "episode.gif"

    def middle(episode: Episode, **options: Any) -> np.ndarray[Any, Any]:
        animate(episode, SPEC, path, size=128, stride=10, **options)
        return frames_of(path)[0][1][:128]

    silent = middle(EPISODE)
    loud = middle(talking)
    assert (loud != silent).any()
    assert (middle(talking, has_messages=False) == silent).all()
    attempted = np.ones((T + 1, N, N), np.bool_)
    mute = make_episode(has_channel=True)
    mute.delivered[:] = False
    assert (middle(mute, attempted=attempted) != silent).any()
    assert (middle(EPISODE, scans=np.full((T + 1, N, 8), 0.5, np.float32)) != silent).any()


@pytest.mark.parametrize("name", ["scans", "attempted"])
def test_a_row_is_needed_for_each_state(tmp_path: Path, name: str) -> None:
    rows: dict[str, Any] = {name: np.ones((T, N, N), np.bool_)}
    with pytest.raises(SchemaError, match=f"{name} has {T} rows, expected {T + 1}"):
        animate(EPISODE, SPEC, tmp_path / "episode.gif", **rows)


def test_the_last_caption_says_how_it_ended(tmp_path: Path) -> None:
    ends = []
    for is_solved in (True, False):
        animate(make_episode(is_solved=is_solved), SPEC, tmp_path / "x.gif", size=192, stride=20)
        ends.append(frames_of(tmp_path / "x.gif")[0][-1])
    apart = np.abs(ends[0] - ends[1]).max(axis=(1, 2))  # of each row; the palettes differ a little
    assert apart[:192].max() < 30
    assert apart[192:].max() > 100


def test_only_known_suffixes_and_positive_strides(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match=r"expected a '.gif' or '.mp4'"):
        animate(EPISODE, SPEC, tmp_path / "episode.avi")
    with pytest.raises(SchemaError, match="stride 0"):
        animate(EPISODE, SPEC, tmp_path / "episode.gif", stride=0)


def test_without_ffmpeg_the_program_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ProgramError, match=r"needs the program ffmpeg.* or write a '.gif'"):
        animate(EPISODE, SPEC, tmp_path / "episode.mp4")
    assert not list(tmp_path.iterdir())


def pretend(folder: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts a program named ffmpeg on the PATH; the last argument is its output."""
    program = folder / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\nfor last; do :; done\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")


def test_ffmpeg_gets_every_frame_and_two_seconds_of_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(tmp_path, f'echo "$@" > {tmp_path}/arguments; cat > "$last"', monkeypatch)
    animate(EPISODE, SPEC, tmp_path / "episode.mp4", size=64, stride=4)
    arguments = (tmp_path / "arguments").read_text()
    assert "-s 64x68 -r 5/2 -i -" in arguments
    raw = np.fromfile(tmp_path / "episode.mp4", np.uint8).reshape(-1, 68, 64, 3)
    assert len(raw) == 6 + 5  # 0.4 s each
    assert (raw[-1] == raw[5]).all()
    assert (raw[0] != raw[1]).any()
    assert {path.name for path in tmp_path.iterdir()} == {"arguments", "bin", "episode.mp4"}


@pytest.mark.parametrize("script", ["echo 'no libx264' >&2; exit 3", "exec <&-; exit 3"])
def test_a_failure_of_ffmpeg_is_told_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str
) -> None:
    pretend(tmp_path, f'echo x > "$last"; {script}', monkeypatch)
    reason = "no libx264" if "libx264" in script else "it gave no reason"
    with pytest.raises(ProgramError, match=f"could not write .*episode.mp4, status 3: {reason}"):
        animate(EPISODE, SPEC, tmp_path / "episode.mp4", size=256)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_an_mp4_can_be_read_back(tmp_path: Path) -> None:
    path = tmp_path / "episode.mp4"
    animate(EPISODE, SPEC, path, size=95)  # odd sides are padded
    raw = subprocess.run(
        ["ffmpeg", "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    ).stdout
    first = np.frombuffer(raw, np.uint8)[: 96 * 100 * 3].reshape(100, 96, 3).astype(int)
    assert len(raw) == (11 + 10) * 96 * 100 * 3
    still = draw(SPEC, EPISODE.layout, EPISODE.states[0], size=95)
    assert np.abs(first[:95, :95] - still).mean() < 4.0


def test_a_png_holds_the_picture(tmp_path: Path) -> None:
    image = draw(SPEC, EPISODE.layout, EPISODE.states[0], size=96)
    save_png(image, tmp_path / "world.png")
    with PIL.open(tmp_path / "world.png") as stored:
        np.testing.assert_array_equal(np.asarray(stored), image)


def test_a_notebook_shows_pictures_and_animations(tmp_path: Path) -> None:
    picture = show(SPEC, EPISODE.layout, EPISODE.states[0], size=96, caption="start")
    assert isinstance(picture, Picture)
    png = picture._repr_png_()
    assert png is not None
    assert png.startswith(b"\x89PNG")
    assert 'src="data:image/png;base64,iVBOR' in picture._repr_html_()
    film = play(EPISODE, SPEC, size=96, stride=10)
    assert film._repr_png_() is None
    assert 'src="data:image/gif;base64,R0lGOD' in film._repr_html_()
    assert repr(film) == f"Picture(gif, {len(film.data)} bytes)"
    film.save(tmp_path / "film.gif")
    assert len(frames_of(tmp_path / "film.gif")[0]) == 3
