"""Rays and messages are drawn where they run, and what was lost looks lost."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.render import Image, draw
from swarmdata.envs.render import colors as ink
from swarmdata.errors import SchemaError
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.task_spec import Role, TaskSpec
from tests.envs.render.pictures import EMPTY, LEFT, RIGHT, SPEC, STATE, n_near, pixel, state_of

pytest.importorskip("PIL.Image")


def changed(a: Image, b: Image) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Where two pictures differ, [H, W]."""
    return np.any(a != b, axis=-1)


LIDAR = SPEC.with_updates(observation=LidarModel(range=1.0))


def test_rays_start_at_the_heading_and_end_in_a_dot_where_they_hit() -> None:
    scan = np.ones((2, 4), np.float32)
    scan[1, 1] = 0.5  # to the left of robot 1, which heads right: up
    image = draw(LIDAR, EMPTY, STATE, scan=scan)
    plain = draw(LIDAR, EMPTY, STATE)
    assert pixel(image, 1, 1.5) == RIGHT
    assert pixel(image, 1, 1.7) == pixel(plain, 1, 1.7)
    assert pixel(image, 0.02, 1) != pixel(plain, 0.02, 1)  # the whole range, and no dot
    assert pixel(image, 0.0, 1) != RIGHT
    state = STATE.copy()
    state[12:14] = [0.0, -1.0]
    assert pixel(draw(LIDAR, EMPTY, state, scan=scan), 1.5, 1) == RIGHT


def test_a_focus_shows_the_rays_of_one_robot_alone_and_stronger() -> None:
    scan = np.full((2, 8), 0.9, np.float32)
    plain, all_of_them, one = (
        draw(LIDAR, EMPTY, STATE, scan=s, focus=f)
        for s, f in ((None, None), (scan, None), (scan, 1))
    )
    assert not changed(plain, one)[:, :250].any()
    assert changed(plain, all_of_them)[:, :250].any()
    assert one[:, 260:].astype(int).sum() < all_of_them[:, 260:].astype(int).sum()


def test_a_scan_without_a_lidar_needs_a_range() -> None:
    scan = np.full((2, 4), 0.5, np.float32)
    with pytest.raises(SchemaError, match=r"observes by 'state'.* Pass scan_range"):
        draw(SPEC, EMPTY, STATE, scan=scan)
    assert pixel(draw(SPEC, EMPTY, STATE, scan=scan, scan_range=1.0), 1, 1.5) == RIGHT


def links(*pairs: tuple[int, int], n: int = 2) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Who (first) heard whom."""
    heard = np.zeros((n, n), np.bool_)
    for pair in pairs:
        heard[pair] = True
    return heard


def test_a_delivered_message_is_an_arrow_in_the_color_of_its_sender() -> None:
    image = draw(SPEC, EMPTY, STATE, messages=(links((1, 0)), None))
    plain = draw(SPEC, EMPTY, STATE)
    where = np.argwhere(changed(image, plain))
    assert where[:, 1].min() > 512 * 1.1 / 4.2  # from the rim of the sender
    assert where[:, 1].max() < 512 * 3.1 / 4.2  # to the rim of the receiver
    assert n_near(image, LEFT) > n_near(plain, LEFT)
    assert n_near(image, RIGHT) <= n_near(plain, RIGHT)
    head = image[:, 330:365]
    tail = image[:, 150:185]
    assert n_near(head, LEFT, 60) > n_near(tail, LEFT, 60) - 40  # the head is the thick end


def test_a_dropped_message_differs_from_a_delivered_one_and_never_arrives() -> None:
    attempted = links((1, 0))
    lost = draw(SPEC, EMPTY, STATE, messages=(links(), attempted))
    plain = draw(SPEC, EMPTY, STATE)
    assert n_near(lost, ink.DROPPED_COLOR, 30) > 5
    assert n_near(lost, LEFT) <= n_near(plain, LEFT)
    assert np.argwhere(changed(lost, plain))[:, 1].max() < 330
    arrived = draw(SPEC, EMPTY, STATE, messages=(attempted, attempted))
    assert n_near(arrived, ink.DROPPED_COLOR, 30) == n_near(plain, ink.DROPPED_COLOR, 30)


def test_robots_do_not_talk_to_themselves_and_places_may_coincide() -> None:
    everyone = np.ones((2, 2), np.bool_)
    once = draw(SPEC, EMPTY, STATE, messages=(links((0, 1), (1, 0)), None))
    np.testing.assert_array_equal(draw(SPEC, EMPTY, STATE, messages=(everyone, None)), once)
    state = STATE.copy()
    state[8:10] = state[:2]
    assert draw(SPEC, EMPTY, state, messages=(links(), everyone)).shape == (512, 512, 3)
    assert draw(SPEC, EMPTY, state, messages=(everyone, None)).shape == (512, 512, 3)


def test_a_crowd_shows_only_what_arrives_at_each_robot() -> None:
    spec = TaskSpec(team=(Role(count=9),))
    rows = [(x, y, 0, 0, 1, 0, 1.9, 1.9) for x in (-1.5, 0, 1.5) for y in (-1.5, 0, 1.5)]
    state = state_of(*rows)
    everyone = np.ones((9, 9), np.bool_)
    where = changed(draw(spec, EMPTY, state, messages=(everyone, None)), draw(spec, EMPTY, state))
    far = np.ones((512, 512), np.bool_)
    ys, xs = np.mgrid[:512, :512] / (512 / 4.2)
    for row in rows:
        far &= np.hypot(xs - 2.1 - row[0], 2.1 - ys - row[1]) > 0.5
    assert where.any()
    assert not (where & far).any()
