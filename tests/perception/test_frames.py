"""Frames: turning the world turns what a policy sees by nothing, and its actions with it."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, SpecError
from swarmdata.perception.frames import HEARING_RANGE, Frame, find_frame, in_world, natural_anchor
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.features import Feature
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import Robot
from swarmdata.types import Float


def framed(features: Sequence[Feature], anchor: str, robots: Sequence[Robot] = ()) -> Frame:
    frame = find_frame(features, anchor, robots)
    assert frame is not None
    return frame


FEATURES = make_env(preset("coop_nav"), 1).features
FRAME = framed(FEATURES, "target")
NAMES = [feature.name for feature in FEATURES]


def some_observations() -> Float:
    return make_env(preset("coop_nav"), 8).reset(np.arange(8, dtype=np.uint64)).observations


def turned(observations: Float, angle: float) -> Float:
    """The same scene in a world that is turned by an angle."""
    out = observations.astype(np.float64)
    for k, feature in enumerate(FEATURES):
        if feature.axis == "x":
            x, y = observations[..., k], observations[..., k + 1]
            out[..., k] = math.cos(angle) * x - math.sin(angle) * y
            out[..., k + 1] = math.sin(angle) * x + math.cos(angle) * y
    return out.astype(np.float32)


def test_a_goal_that_is_hidden_turns_nothing() -> None:
    hidden = make_env(with_models(preset("coop_nav"), "state+goal-for-10"), 1).features
    assert natural_anchor(FEATURES) == "target"
    assert natural_anchor(hidden) == "world"
    with pytest.raises(SpecError, match=r"own\.goal_dx, .* 'auto' \(here 'world'\)"):
        find_frame(hidden, "target")


def test_the_kernel_computes_what_is_written_here() -> None:
    observations = some_observations()
    observations[0, 0, FRAME.anchor : FRAME.anchor + 2] = 0  # no direction
    ux, uy = FRAME.directions(observations)
    expected = np.empty((*observations.shape[:-1], len(NAMES) + FRAME.n_added), np.float32)
    expected[..., : len(NAMES)] = observations
    here = observations.astype(np.float64)
    for k in FRAME.vectors:
        expected[..., k] = ux * here[..., k] + uy * here[..., k + 1]
        expected[..., k + 1] = ux * here[..., k + 1] - uy * here[..., k]
    expected[..., len(NAMES)], expected[..., len(NAMES) + 1] = ux, uy
    for c, (near, speed) in enumerate(FRAME.closing):
        expected[..., len(NAMES) + 2 + c] = (
            here[..., near] * here[..., speed] + here[..., near + 1] * here[..., speed + 1]
        )
    np.testing.assert_array_equal(FRAME.inputs(observations), expected)
    every_second = np.asfortranarray(observations[::2])
    np.testing.assert_array_equal(FRAME.inputs(every_second), expected[::2])


def test_the_kernel_turns_commands_back_as_numpy_does() -> None:
    observations = some_observations()
    observations[0, 0, FRAME.anchor : FRAME.anchor + 2] = 0  # no direction
    actions = np.random.default_rng(0).uniform(-1, 1, (8, 4, 3))
    actions[1, 2] = np.nan
    turned = FRAME.to_world(observations, actions)
    norm = np.maximum(np.sqrt(turned[..., 0] ** 2 + turned[..., 1] ** 2), 1.0)
    turned[..., :2] /= norm[..., None]
    expected = turned.clip(-1.0, 1.0)
    np.testing.assert_array_equal(in_world(FRAME, observations, actions), expected)
    every_second = np.asfortranarray(observations[::2]), np.asfortranarray(actions[::2])
    np.testing.assert_array_equal(in_world(FRAME, *every_second), expected[::2])


def hearing(payload: str) -> tuple[Frame, list[str], Float]:
    """A frame, names and observations of robots that know of each other by messages only."""
    spec = with_models(preset("coop_nav"), "state-0", payload)
    env = make_env(spec, 8)
    step = env.reset(np.arange(8, dtype=np.uint64))
    for _ in range(5):
        step = env.step(np.full((8, 4, 2), 0.5, np.float32))
    frame = framed(env.features, "target")
    return frame, [feature.name for feature in env.features], step.observations


@pytest.mark.parametrize("payload", ["perfect", "state"])
def test_senders_are_shown_by_their_nearness(payload: str) -> None:
    frame, names, observations = hearing(payload)
    assert len(frame.heard) == 3
    added = frame.inputs(observations)[..., len(names) + 2 + len(frame.closing) :]
    assert added.shape[-1] == 9
    ux, uy = frame.directions(observations)
    here = {name: observations[..., k].astype(np.float64) for k, name in enumerate(names)}
    n_near = 0
    for slot in range(3):
        x, y = here[f"message_{slot}.position_x"], here[f"message_{slot}.position_y"]
        distance = np.hypot(x, y)
        nearness = np.maximum(1 - distance / HEARING_RANGE, 0) / distance
        vx, vy = (
            here[f"own.v{axis}"] - here.get(f"message_{slot}.velocity_{axis}", 0.0) for axis in "xy"
        )
        expected = (ux * x + uy * y, ux * y - uy * x, x * vx + y * vy)
        for k, value in enumerate(expected):
            np.testing.assert_allclose(added[..., 3 * slot + k], nearness * value, atol=1e-6)
        n_near += int((nearness > 0).sum())
    assert 0 < n_near < 3 * x.size


@pytest.mark.parametrize(
    ("task", "sensor", "anchor"),
    [
        ("warehouse", None, "target"),
        ("formation", None, "target"),
        ("transport", None, "target"),
        ("coop_nav", "occupancy", "world"),
        ("robotarium", None, "own.heading"),
        ("formation-unicycle", None, "own.heading"),
        ("coop_nav-mixed", None, "target"),
        ("coop_nav-unicycle", "lidar", "world"),
    ],
)
def test_robots_turn_to_targets_and_unicycles_with_their_heading(
    task: str, sensor: str | None, anchor: str
) -> None:
    spec = with_models(preset(task), sensor)
    features = make_env(spec, 1).features
    assert natural_anchor(features, spec.robots) == anchor
    frame = find_frame(features, "auto", spec.robots)
    assert frame == find_frame(features, anchor, spec.robots)
    is_holonomic = [robot.dynamics == "holonomic" for robot in spec.robots]
    assert frame is None or frame.turns(spec.n_agents).tolist() == is_holonomic


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.floats(-math.pi, math.pi))
def test_what_is_seen_does_not_turn_with_the_world(angle: float) -> None:
    observations = some_observations()
    size = observations.shape[-1]
    seen, again = FRAME.inputs(observations), FRAME.inputs(turned(observations, angle))
    np.testing.assert_allclose(seen[..., :size], again[..., :size], atol=2e-6)
    np.testing.assert_allclose(seen[..., size + 2 :], again[..., size + 2 :], atol=2e-6)
    ux, uy = again[..., size], again[..., size + 1]
    np.testing.assert_allclose(ux**2 + uy**2, 1, atol=1e-6)


def test_actions_go_to_the_world_and_back() -> None:
    observations = some_observations()
    actions = np.random.default_rng(0).uniform(-1, 1, (8, 4, 2))
    there = FRAME.to_world(observations, actions)
    np.testing.assert_allclose(FRAME.to_local(observations, there), actions, atol=1e-12)
    lengths = np.linalg.norm(actions, axis=-1)
    np.testing.assert_allclose(np.linalg.norm(there, axis=-1), lengths, atol=1e-12)


def test_frames_are_found_by_name() -> None:
    assert find_frame(FEATURES, "world") is None
    assert find_frame(make_env(preset("formation"), 1).features, "reference.heading") is not None
    assert find_frame(FEATURES, "auto") == FRAME
    lidar = with_models(preset("coop_nav"), "lidar", None)
    assert find_frame(make_env(lidar, 1).features, "auto") is None
    with pytest.raises(SpecError, match="payload_goal"):
        find_frame(FEATURES, "payload_goal")


def test_commands_of_unicycles_cannot_be_turned() -> None:
    spec = preset("robotarium")
    features = make_env(spec, 1).features
    assert find_frame(features, "world", spec.robots) is None
    with pytest.raises(SpecError, match="all robots are unicycles"):
        find_frame(features, "target", spec.robots)


def test_in_a_mixed_team_unicycles_turn_to_their_heading_and_others_to_the_anchor() -> None:
    env = make_env(preset("coop_nav-mixed"), 4)
    names = [feature.name for feature in env.features]
    frame = framed(env.features, "target", env.spec.robots)
    heading = framed(env.features, "own.heading", env.spec.robots)
    observations = env.reset(np.arange(4, dtype=np.uint64)).observations
    is_rover = np.array([robot.dynamics == "unicycle" for robot in env.spec.robots])
    seen = frame.inputs(observations)
    np.testing.assert_array_equal(seen[:, is_rover], heading.inputs(observations)[:, is_rover])
    goal = [names.index("own.goal_dx"), names.index("own.goal_dy")]
    ahead, aside = np.moveaxis(seen[:, ~is_rover][..., goal], -1, 0)
    distance = np.linalg.norm(observations[:, ~is_rover][..., goal], axis=-1)
    np.testing.assert_allclose(ahead, distance, atol=1e-5)
    np.testing.assert_allclose(aside, 0.0, atol=1e-5)
    actions = np.random.default_rng(0).uniform(-0.7, 0.7, (4, 4, 2))
    there = frame.to_world(observations, actions)
    np.testing.assert_allclose(in_world(frame, observations, actions), there, atol=1e-15)
    np.testing.assert_array_equal(there[:, is_rover], actions[:, is_rover])
    assert (np.abs(there - actions)[:, ~is_rover] > 1e-6).all()
    np.testing.assert_allclose(frame.to_local(observations, there), actions, atol=1e-12)
    fast = np.ones((4, 4, 2), np.float32)  # longer than 1: clipped where it is a vector
    lengths = np.linalg.norm(frame.recorded(observations, fast), axis=-1)
    np.testing.assert_allclose(lengths, np.where(is_rover, np.sqrt(2), 1.0)[None].repeat(4, 0))


def test_unicycles_that_observe_in_their_own_frame_see_the_same_in_that_of_their_heading() -> None:
    env = make_env(with_models(preset("intersection"), "body-frame"), 1)
    frame = framed(env.features, "auto")
    observations = env.reset(np.arange(1, dtype=np.uint64)).observations
    seen = frame.inputs(observations)[..., : len(env.features)]
    np.testing.assert_array_equal(seen, observations)


def test_the_frame_of_a_heading_turns_what_unicycles_see_but_not_their_commands() -> None:
    env = make_env(preset("intersection"), 4)
    frame = framed(env.features, "own.heading")
    assert not frame.turns(4).any()
    observations = env.reset(np.arange(4, dtype=np.uint64)).observations
    names = [feature.name for feature in env.features]
    inputs = frame.inputs(observations)
    np.testing.assert_allclose(inputs[..., names.index("own.heading_x")], 1.0, atol=1e-6)
    np.testing.assert_allclose(inputs[..., names.index("own.heading_y")], 0.0, atol=1e-6)
    actions = np.full((4, 4, 2), 0.9, np.float32)  # longer than 1: no vector to be clipped
    for same in (
        frame.to_world(observations, actions),
        frame.to_local(observations, actions),
        frame.recorded(observations, actions),
        in_world(frame, observations, actions.astype(np.float64)),
    ):
        np.testing.assert_array_equal(same, actions)


@pytest.mark.parametrize("extra", [-1, 16])
def test_other_observations_are_refused(extra: int) -> None:
    """The kernels read and write by the columns of a frame: these were outside of the arrays."""
    seen = np.zeros((2, 4, len(FEATURES) + extra), np.float32)
    refused = f"observations of {len(FEATURES)} features, got {seen.shape[-1]}"
    with pytest.raises(SchemaError, match=refused):
        FRAME.inputs(seen)
    with pytest.raises(SchemaError, match=refused):
        in_world(FRAME, seen, np.zeros((2, 4, 2)))


def test_a_frame_in_a_file_needs_its_columns() -> None:
    stored = replace(FRAME)
    assert stored == FRAME
    assert stored.n_features is None
    stored.check(np.zeros((1, 4, len(FEATURES) + 1), np.float32))
    with pytest.raises(SchemaError, match=r"of at least \d+ features, got 3"):
        stored.inputs(np.zeros((1, 4, 3), np.float32))


@pytest.mark.parametrize(
    ("frame", "fits"),
    [
        (Frame(8, (8,), ()), True),
        (Frame(9, (0,), ()), False),
        (Frame(0, (0,), (), ((4, 2, 6),)), True),
        (Frame(0, (0,), (), ((4, 2, -1),)), True),
        (Frame(0, (0,), (), ((4, 2, 9),)), False),
        (Frame(0, (0,), (), ((-1, 2, 6),)), False),
    ],
)
def test_a_frame_knows_the_observations_it_fits(frame: Frame, fits: bool) -> None:
    assert frame.fits(10) is fits
