"""A picture shows every part of a world where it is."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.envs.render import Image, draw
from swarmdata.envs.render import colors as ink
from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.numerics.geometry import BOX, CIRCLE, POCKET
from swarmdata.specs.rules import Payload
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.task_spec import Arena, Robot, Role, TaskSpec
from tests.envs.render.pictures import EMPTY, LEFT, RIGHT, SPEC, STATE, n_near, pixel, state_of

pytest.importorskip("PIL.Image")


def test_floor_walls_robots_and_goals_are_where_they_are() -> None:
    image = draw(SPEC, EMPTY, STATE)
    assert image.shape == (512, 512, 3)
    assert image.dtype == np.uint8
    assert pixel(image, 0.3, 0.5) == ink.FLOOR_COLOR
    assert pixel(image, 2.06, 0) == pixel(image, 0, -2.06) == ink.OBSTACLE_COLOR
    assert pixel(image, -1, 1.09) == LEFT
    assert pixel(image, 1, 1.09) == RIGHT
    assert pixel(image, -0.94, 1) == ink.WHITE  # the wedge points along the velocity
    assert pixel(image, -1.09, 1) == LEFT
    assert pixel(image, 1, 1) == ink.WHITE  # a holonomic robot at rest has a dot
    assert pixel(image, -1, -1) == LEFT  # the dot in an open goal


def test_floor_and_walls_are_filled_and_not_blended(monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL.ImageDraw import ImageDraw

    modes, rectangle = [], ImageDraw.rectangle

    def counted(pen: ImageDraw, *args: Any, **options: Any) -> None:
        modes.append(pen.mode)  # RGBA: each pixel is blended with what is below it
        rectangle(pen, *args, **options)

    monkeypatch.setattr(ImageDraw, "rectangle", counted)
    draw(SPEC, EMPTY, STATE)
    assert modes == ["RGB", "RGB"]


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
    assert {p for p in solid | free if pixel(image, *p) == ink.OBSTACLE_COLOR} == solid


def test_a_unicycle_at_rest_shows_its_heading() -> None:
    spec = SPEC.with_updates(team=(Role(count=2, robot=Robot(dynamics="unicycle")),))
    state = STATE.copy()
    state[12:14] = [0.0, -1.0]  # robot 1 looks down
    image = draw(spec, EMPTY, state)
    assert pixel(image, 1, 0.94) == ink.WHITE
    assert pixel(image, 1, 1.09) == RIGHT


def test_a_contact_has_a_halo_only_around_those_who_touch() -> None:
    events = np.zeros((2, 4), np.uint8)
    events[1, 1] = 1
    image = draw(SPEC, EMPTY, STATE, events=events)
    assert pixel(image, 1, 1.155) == ink.CONTACT_COLOR
    assert pixel(image, -1, 1.155) != ink.CONTACT_COLOR
    assert n_near(draw(SPEC, EMPTY, STATE), ink.CONTACT_COLOR) == 0


@pytest.mark.parametrize("radius", [0.2, 0.3])
def test_a_goal_is_filled_within_the_radius_of_its_task(radius: float) -> None:
    spec = SPEC.with_updates(rules=NavigationRules(goal_radius=radius))
    state = STATE.copy()
    state[8:10] = [1.0, 1.02 - radius]
    assert pixel(draw(spec, EMPTY, state), 1, 1.1) == ink.tint(RIGHT, 0.5)
    state[8:10] = [1.0, 0.98 - radius]
    assert pixel(draw(spec, EMPTY, state), 1, 1.1) == ink.tint(RIGHT, 0.1)


def test_unassigned_goals_are_neutral_and_filled_by_any_robot() -> None:
    spec = SPEC.with_updates(rules=NavigationRules(goals="unassigned"))
    state = np.append(STATE, STATE[[6, 7, 14, 15]])  # the goals follow the robots
    state[6:8] = state[14:16] = 0.0  # targets are not what is drawn
    state[8:10] = [-1.0, -0.88]  # robot 1 on goal 0
    image = draw(spec, EMPTY, state)
    assert pixel(image, -1, -1.1) == ink.tint(ink.UNASSIGNED_COLOR, 0.5)
    assert pixel(image, 1, 1.1) == ink.tint(ink.UNASSIGNED_COLOR, 0.1)


def test_formation_slots_are_crosses_that_light_up_when_held() -> None:
    spec = SPEC.with_updates(rules=FormationRules(tolerance=0.2))
    image = draw(spec, EMPTY, STATE)
    assert pixel(image, -1, -1) == LEFT
    assert pixel(image, -1.05, -0.95) == LEFT  # diagonal arms, no ring
    assert pixel(image, -0.9, -1.05) == ink.FLOOR_COLOR
    assert pixel(image, 1.0, 1.17) == ink.tint(RIGHT, 0.3)
    column = [pixel(image, -1, y) for y in np.arange(-0.8, 0.8, 0.01)]
    assert 0.2 < np.mean([red < 180 for red, _, _ in column]) < 0.8  # a dashed tie to the robot


BRICK = Payload(shape="box", half_length=0.35, half_width=0.2)
BODY = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
GOAL = (1.0, -1.0)


def transport(rules: TransportRules, body: tuple[float, ...], *extras: float) -> Image:
    spec = SPEC.with_updates(rules=rules)
    rows = [(-1, 1, 0, 0, 1, 0, *GOAL), (1, 1, 0, 0, 1, 0, *GOAL)]
    return draw(spec, EMPTY, state_of(*rows, extras=(*body, *extras)))


def test_a_payload_is_solid_with_its_shape_and_direction() -> None:
    image = transport(TransportRules(payload=BRICK), BODY)
    assert pixel(image, -0.28, 0.12) == pixel(image, 0.3, -0.15) == ink.PAYLOAD_COLOR
    assert pixel(image, 0.1, 0.25) == pixel(image, 0.42, 0.1) == ink.FLOOR_COLOR
    assert pixel(image, 0.1, 0) == ink.PAYLOAD_EDGE_COLOR  # the arrow
    assert pixel(image, -0.28, 0) == ink.PAYLOAD_COLOR
    turned = transport(TransportRules(payload=BRICK), (*BODY[:4], 0.0, 1.0, 0.0))
    assert pixel(turned, 0, 0.3) == ink.PAYLOAD_COLOR
    assert pixel(turned, 0.28, 0.1) == ink.FLOOR_COLOR
    disc = transport(TransportRules(payload=Payload(shape="circle")), BODY)
    assert pixel(disc, 0, 0.3) == ink.PAYLOAD_COLOR
    assert pixel(disc, 0.3, 0.3) == ink.FLOOR_COLOR


def test_the_payload_goal_has_the_pose_that_the_task_asks_for() -> None:
    any_pose = transport(TransportRules(payload=BRICK), BODY, 0.0, 1.0)
    assert pixel(any_pose, 1.28, -1.1) != ink.FLOOR_COLOR  # as the payload is turned now
    assert pixel(any_pose, 1.1, -0.72) == ink.FLOOR_COLOR
    upright = transport(TransportRules(payload=BRICK, goal_angle=0.2), BODY, 0.0, 1.0)
    assert pixel(upright, 1.28, -1.1) == ink.FLOOR_COLOR
    assert pixel(upright, 1.1, -0.72) != ink.FLOOR_COLOR


def test_the_longer_side_has_the_size_and_a_caption_adds_a_strip() -> None:
    wide = SPEC.with_updates(arena=Arena(width=6.0, height=3.0))
    plain = draw(wide, EMPTY, STATE, size=300)
    assert plain.shape == (155, 300, 3)
    titled = draw(wide, EMPTY, STATE, size=300, caption="1.0 s")
    assert titled.shape[0] > 155
    np.testing.assert_array_equal(titled[:150], plain[:150])
    assert titled[160:].min() < 150  # ink


LIDAR = SPEC.with_updates(observation=LidarModel(range=1.0))
SCAN = np.ones((2, 4), np.float32)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layout": np.zeros((1, 3), np.float32)}, r"layout is \[1, 3\], expected \[M, 8\]"),
        ({"state": STATE[:6]}, r"states are \[6\], expected at least \[..., 16\]"),
        ({"state": STATE[None]}, r"state is \[1, 16\], expected \[S\]"),
        ({"state": np.full(16, np.nan, np.float32)}, "of finite numbers"),
        ({"size": 8}, "size is 8 pixels, expected at least 64"),
        ({"trails": np.zeros((3, 15), np.float32)}, r"trails are \[3, 15\], expected \[K, 16\]"),
        ({"events": np.zeros((2, 3), np.uint8)}, r"events are \[2, 3\], expected \[2, 4\]"),
        ({"messages": (np.ones((2, 3), np.bool_), None)}, r"delivered is \[2, 3\]"),
        ({"messages": (np.ones((2, 2), np.bool_), np.ones(2, np.bool_))}, r"attempted is \[2\]"),
        ({"scan": SCAN[:1]}, r"scan is \[1, 4\], expected \[2, K\]"),
        ({"scan": 2 * SCAN}, r"outside \[0, 1\]"),
        ({"scan": np.nan * SCAN}, r"outside \[0, 1\]"),
        ({"scan": SCAN, "focus": 2}, "focus is robot 2, expected 0 to 1"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"layout": EMPTY, "state": STATE, **change}
    with pytest.raises(SchemaError, match=message):
        draw(LIDAR, **arguments)


def changed(a: Image, b: Image) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Where two pictures differ, [H, W]."""
    return np.any(a != b, axis=-1)


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


def test_a_lidar_of_one_ray_is_drawn_as_that_ray() -> None:
    scan = np.full((2, 1), 0.5, np.float32)
    image = draw(SPEC, EMPTY, STATE, scan=scan, scan_range=1.0)
    where = np.argwhere(changed(image, draw(SPEC, EMPTY, STATE)))
    assert where[:, 0].max() < 512 * 1.2 / 4.2  # at the height of the robots, along their headings


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


def test_a_state_without_its_payload_is_refused() -> None:
    with pytest.raises(SchemaError, match=r"expected at least \[..., 23\] for 2 robots and 1 pay"):
        draw(SPEC.with_updates(rules=TransportRules()), EMPTY, STATE)


def test_without_pillow_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swarmdata\[plots\]'"):
        draw(SPEC, EMPTY, STATE)


RULES: tuple[Callable[[], Any], ...] = (
    NavigationRules,
    FormationRules,
    TransportRules,
    WarehouseRules,
)


@given(st.data())
def test_every_task_and_any_state_can_be_drawn(data: st.DataObject) -> None:
    rules = data.draw(st.sampled_from(RULES))()
    n = data.draw(st.integers(1, 6))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    spec = TaskSpec(rules=rules, team=(Role(count=n),), observation=LidarModel())
    state = random.uniform(-3, 3, 8 * n + 7).astype(np.float32)
    state[8 * np.arange(n)[:, None] + [0, 1]] = random.uniform(-1.5, 1.5, (n, 2))
    image = draw(
        spec,
        EMPTY,
        state,
        trails=random.uniform(-3, 3, (4, len(state))).astype(np.float32),
        events=random.integers(0, 2, (n, 4), np.uint8),
        scan=random.random((n, 5), np.float32),
        messages=(random.random((n, n)) < 0.5, random.random((n, n)) < 0.5),
        size=96,
    )
    assert image.shape == (96, 96, 3)
    last = state[8 * (n - 1) : 8 * n]  # drawn last, so nothing hides it
    assert n_near(image, ink.robot_color(n - 1), 40) > 3, last
