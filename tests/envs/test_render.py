"""A picture shows every part of a world where it is."""

import sys
from pathlib import Path

import numpy as np
import pytest

from swarmdata.envs import render
from swarmdata.envs.render import animate, draw
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.geometry import BOX, CIRCLE, POCKET
from swarmdata.registry import make_env
from swarmdata.rollout import rollout
from swarmdata.spec import Arena, Role, TaskSpec
from swarmdata.types import Episode, Float, Int, Step

PIL = pytest.importorskip("PIL.Image")

SPEC = TaskSpec(team=(Role(count=2),), horizon=20)
EMPTY = np.zeros((0, 8), np.float32)
# robot 0 at (-1, 1) drives right to a far goal; robot 1 stands in its goal at (1, 1)
STATE = np.array([-1, 1, 0.5, 0, -1, -1, 1, 1, 0, 0, 1, 1], np.float32)


def pixel(image: render.Image, x: float, y: float) -> tuple[int, ...]:
    """Color at a place given in metres, for the default 4 m arena with 0.1 m of wall."""
    scale = image.shape[1] / 4.2
    return tuple(image[int((2.1 - y) * scale), int((x + 2.1) * scale)].tolist())


def test_floor_walls_robots_and_goals_are_where_they_are() -> None:
    image = draw(SPEC, EMPTY, STATE)
    assert image.shape == (512, 512, 3)
    assert image.dtype == np.uint8
    assert pixel(image, 0.3, 0.5) == render._FLOOR
    assert pixel(image, 2.06, 0) == pixel(image, 0, -2.06) == render._SOLID
    assert pixel(image, -1, 1.09) == render.ROBOT_COLORS[0]
    assert pixel(image, 1, 1.09) == render.ROBOT_COLORS[1]
    assert pixel(image, -0.94, 1) == (255, 255, 255)  # the wedge points along the velocity
    assert pixel(image, -1.09, 1) == render.ROBOT_COLORS[0]
    assert pixel(image, -1, -1) == render.ROBOT_COLORS[0]  # the dot in an open goal


def test_a_reached_goal_is_filled() -> None:
    left = STATE.copy()
    left[6:8] = [1.0, 0.0]
    reached = STATE.copy()
    reached[6:8] = [1.0, 0.86]
    goal = (1.0, 1.1)
    assert pixel(draw(SPEC, EMPTY, left), *goal) == render._tint(render.ROBOT_COLORS[1], 0.1)
    assert pixel(draw(SPEC, EMPTY, reached), *goal) == render._tint(render.ROBOT_COLORS[1], 0.5)


def test_obstacles_are_drawn_from_the_same_bars_as_the_physics() -> None:
    layout = np.array(
        [
            [CIRCLE, -1.5, 0, 1, 0, 0.2, 0.2, 0],
            [BOX, 0, 0, 0, 1, 0.3, 0.1, 0],  # local x is up
            [POCKET, 1.4, -1, 1, 0, 0.3, 0.3, 0.05],  # opens upwards
        ],
        np.float32,
    )
    image = draw(SPEC, layout, STATE)
    solid = {(-1.5, 0.15), (0, 0.25), (1.4, -1.25), (1.13, -0.8), (1.67, -0.8)}
    free = {(-1.5, 0.25), (0.15, 0), (1.4, -1.0), (1.4, -0.72)}
    assert {p for p in solid | free if pixel(image, *p) == render._SOLID} == solid


def test_a_contact_has_a_halo_only_around_those_who_touch() -> None:
    events = np.zeros((2, 4), np.uint8)
    events[1, 1] = 1
    image = draw(SPEC, EMPTY, STATE, events=events)
    assert pixel(image, 1, 1.155) == render._CONTACT
    assert pixel(image, -1, 1.155) != render._CONTACT


def test_trails_fade_into_the_past() -> None:
    trails = np.repeat(STATE[None], 21, axis=0)
    trails[:, 0] = np.linspace(-1.9, -1.0, 21)
    image = draw(SPEC, EMPTY, STATE, trails=trails).astype(int)
    old, new = pixel(image, -1.85, 1), pixel(image, -1.2, 1)
    assert sum(render._FLOOR) > sum(old) > sum(new) > sum(render.ROBOT_COLORS[0])


def test_the_longer_side_has_the_size_and_a_caption_adds_a_strip() -> None:
    wide = SPEC.with_updates(arena=Arena(width=6.0, height=3.0))
    plain = draw(wide, EMPTY, STATE, size=300)
    assert plain.shape == (155, 300, 3)
    titled = draw(wide, EMPTY, STATE, size=300, caption="1.0 s")
    assert titled.shape[0] > 155
    np.testing.assert_array_equal(titled[:150], plain[:150])
    assert titled[160:].min() < 150  # ink


@pytest.mark.parametrize(
    ("layout", "state", "size", "message"),
    [
        (np.zeros((1, 3), np.float32), STATE, 512, r"layout is \[1, 3\], expected \[M, 8\]"),
        (EMPTY, STATE[:6], 512, r"states are \[6\], expected \[..., 12\]"),
        (EMPTY, STATE, 8, "size is 8 pixels, expected at least 64"),
    ],
)
def test_what_does_not_fit_is_refused(layout: Float, state: Float, size: int, message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        draw(SPEC, layout, state, size=size)


class Straight:
    uses_state = False

    def reset(self, step: Step, copies: Int) -> None:
        pass

    def act(self, step: Step) -> Float:
        return np.clip(step.observations[..., 6:8], -1.0, 1.0)


@pytest.fixture(scope="module")
def episode() -> Episode:
    return next(rollout(make_env(SPEC), Straight(), np.array([7], np.uint64)))


def test_a_gif_plays_in_real_time_and_shows_the_end(tmp_path: Path, episode: Episode) -> None:
    path = tmp_path / "episode.gif"
    animate(episode, SPEC, path, size=256, stride=3)
    with PIL.open(path) as gif:
        durations = []
        for frame in range(gif.n_frames):
            gif.seek(frame)
            durations.append(gif.info["duration"])
        last = np.asarray(gif.convert("RGB")).astype(int)
    n_frames = len({*range(0, len(episode), 3), len(episode)})
    assert durations == [300] * (n_frames - 1) + [2000]
    end = draw(
        SPEC,
        episode.layout,
        episode.states[-1],
        trails=episode.states,
        events=episode.events[-3:].max(axis=0),
        size=256,
    )
    assert np.abs(last[:256] - end).mean() < 2.0  # the palette's rounding
    assert path.stat().st_size < 2_000_000 * n_frames / 100


def test_only_gifs_and_positive_strides(tmp_path: Path, episode: Episode) -> None:
    with pytest.raises(SchemaError, match=r"expected a '.gif'"):
        animate(episode, SPEC, tmp_path / "episode.mp4")
    with pytest.raises(SchemaError, match="stride 0"):
        animate(episode, SPEC, tmp_path / "episode.gif", stride=0)


def test_without_pillow_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swarmdata\[plots\]'"):
        draw(SPEC, EMPTY, STATE)
