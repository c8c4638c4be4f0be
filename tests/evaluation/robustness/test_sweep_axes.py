"""Axes of a sweep: their notation, what can be swept, and the specs that they give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.errors import SpecError, SwarmdataError, UnknownNameError
from swarmdata.evaluation.robustness.sweep_axes import (
    Axis,
    Part,
    Place,
    changed,
    parameters,
    parse_axis,
    specs_along_axis,
)
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.frozen import differences
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.sensing_models import SensorNoise
from swarmdata.specs.task_spec import Robot, Role, TaskSpec

KINDS = ("state", "lidar", "bearing", "occupancy")
TALKING = with_models(TaskSpec(), communication="lossy-30")
DECIMALS = st.decimals(-100, 100, places=3).map(lambda number: number.normalize())


@given(DECIMALS, DECIMALS, st.integers(2, 12))
def test_a_span_holds_its_ends_and_even_steps(low: object, high: object, n: int) -> None:
    if low == high:
        with pytest.raises(SpecError, match="two or more different"):
            parse_axis(f"noise={low}..{high}", "observation", n)
        return
    values = parse_axis(f"noise={low}..{high}", "observation", n).values
    assert (values[0], values[-1], len(values)) == (float(str(low)), float(str(high)), n)
    steps = np.diff(values)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9, atol=1e-12)
    assert parse_axis(f"noise={high}..{low}", "observation", n).values == values[::-1]


@given(st.lists(st.floats(0, 1e6), min_size=2, max_size=8, unique=True))
def test_a_list_is_taken_as_it_is(values: list[float]) -> None:
    text = f" drop = {', '.join(map(repr, values))}"
    assert parse_axis(text, "communication") == Axis("communication", "drop", tuple(values))


@given(st.integers(0, 30), st.integers(1, 30), st.integers(2, 9))
def test_whole_numbers_stay_whole_and_are_not_repeated(low: int, width: int, n: int) -> None:
    values = parse_axis(f"delay={low}..{low + width}", "observation", n).values
    assert all(isinstance(value, int) for value in values)
    assert list(values) == sorted(set(values))
    assert (values[0], values[-1]) == (low, low + width)
    assert len(values) == min(n, width + 1)


def test_points_are_the_numbers_that_people_mean() -> None:
    assert parse_axis("drop=0..0.8", "communication").values == (0.0, 0.2, 0.4, 0.6, 0.8)
    assert parse_axis("bandwidth=3..1", "communication").values == (3, 2, 1)
    assert parse_axis("bandwidth=3..1", "communication").falls


@pytest.mark.parametrize(
    "text",
    ["drop", "drop=", "=1,2", "drop=0.5", "drop=0..", "drop=0..nan", "drop=a,b", "drop=1,1", "drop="
     "0..1..2", "drop=0,,1"],
)  # fmt: skip
def test_malformed_axes_show_how_to_write_them(text: str) -> None:
    with pytest.raises(SpecError, match=r"such as drop=0\.\.0\.8"):
        parse_axis(text, "communication")


@pytest.mark.parametrize(
    ("axis", "observation", "communication"),
    [
        ("noise=0,0.2", "state+noise-0.2", None),
        ("drift=0,0.02", "state+drift-0.02", None),
        ("range=3,1.5", "state+range-1.5", None),
        ("dropout=0,0.1", "state+dropout-0.1", None),
        ("delay=0,2", "state+delay-2", None),
        ("drop=0,0.6", None, "=lossy-60"),
        ("delay=0,3", None, "=lossy-30+delayed-3"),
        ("bandwidth=2,1", None, "=lossy-30+bandwidth-1"),
        ("range=3,1.5", None, "=lossy-30+range-1.5"),
        ("bits=8,3", None, "=lossy-30+bits-3"),
        ("slots=9,4", None, "=lossy-30+aloha-4"),
    ],
)
def test_names_mean_what_they_mean_in_models(
    axis: str, observation: str | None, communication: str | None
) -> None:
    parsed = parse_axis(axis, "communication" if observation is None else "observation")
    course = specs_along_axis(parsed, "bc", TALKING)
    assert course.specs[-1] == with_models(TALKING, observation, communication)


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_that_leaves_features_alone_is_a_parameter(kind: str) -> None:
    spec = with_models(TALKING, kind)
    heard, seen = parameters(spec, "communication"), parameters(spec, "observation")
    assert heard.keys() >= {"range", "drop_probability", "delay", "bits", "bursts.enter", "drop"}
    assert seen.keys() >= {"dropout", "delay", "noise.position", "noise.velocity", "noise", "range"}
    shapes = {"n_neighbors", "n_obstacles", "n_rays", "cells", "cell_size", "stack"}
    assert not (heard.keys() | seen.keys()) & (shapes | {"message_size", "n_nearest"})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", SensorNoise.model_fields)
def test_a_noise_is_a_parameter_if_and_only_if_robots_feel_it(kind: str, noise: str) -> None:
    quiet, loud = (with_models(TaskSpec(), {"kind": kind, "noise": {noise: s}}) for s in (0.0, 0.3))
    seen = [make_env(spec).reset(np.array([3], np.uint64)).observations for spec in (quiet, loud)]
    offered = f"noise.{noise}" in parameters(quiet, "observation")
    assert offered == (not np.array_equal(seen[0], seen[1]))


@pytest.mark.parametrize("kind", KINDS)
def test_headings_drift_where_robots_have_some_and_landmarks_correct_drift(kind: str) -> None:
    plain, drifting = (with_models(TaskSpec(), name) for name in (kind, f"{kind}+drift-0.1"))
    turning = with_models(preset("coop_nav-unicycle"), kind)
    headings = {"drift.heading", "drift.turning"}
    for spec in (plain, drifting, turning):
        seen = parameters(spec, "observation").keys()
        assert seen >= {"drift", "drift.position"}
        assert (seen & headings == headings) == (spec is turning)
        assert ("landmarks" in seen) == (spec is drifting)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("part", ["communication", "observation"])
def test_an_axis_changes_its_parameter_and_nothing_else(part: Part, kind: str) -> None:
    spec = with_models(TALKING, kind)
    for name, places in parameters(spec, part).items():
        value = next(v for v in (1, 0.5) if _is_accepted(spec, places, v))
        course = specs_along_axis(Axis(part, name, (value,)), "bc", spec)
        paths = {path for path, _, _ in differences(spec, course.specs[0])}
        allowed = [".".join(map(str, place[:2])).replace(".0", "[0]") for place in places]
        assert all(path.startswith(tuple(allowed)) for path in paths), (name, paths)


def _is_accepted(spec: TaskSpec, places: tuple[Place, ...], value: float) -> bool:
    try:
        changed(spec, places, value, "a test")
    except SpecError:
        return False
    return True


@pytest.mark.parametrize(
    "name", ["max_speed", "max_acceleration", "max_turn_rate", "wheel_grip", "actuator_lag"]
)
def test_an_axis_of_the_body_changes_the_robots_that_have_it(name: str) -> None:
    team = (Role(name="a"), Role(name="b", robot=Robot(dynamics="unicycle")))
    spec = TaskSpec(team=team)
    found = specs_along_axis(parse_axis(f"{name}=0.5,0.25", "body"), "bc", spec)
    assert found.trained == getattr(Robot(), name)
    for value, offered in zip((0.5, 0.25), found.specs, strict=True):
        paths = {path for path, _, there in differences(spec, offered) if there == value}
        roles = (1,) if name in {"max_turn_rate", "wheel_grip"} else (0, 1)
        assert paths == {f"team[{k}].robot.{name}" for k in roles}
        assert paths == {path for path, *_ in differences(spec, offered)}


def test_a_delay_of_commands_is_whole() -> None:
    axis = parse_axis("command_delay=0..4", "body", 3)
    assert list(axis.values) == [0, 2, 4]
    found = specs_along_axis(axis, "bc", TaskSpec())
    assert (found.trained, found.specs[0]) == (0, TaskSpec())
    assert [spec.robots[0].command_delay for spec in found.specs] == [0, 2, 4]


def test_a_payload_is_part_of_the_bodies() -> None:
    spec = preset("transport")
    axis = parse_axis("payload_mass=2..8", "body", 3)
    masses = [
        each.rules_as(TransportRules).payload.mass
        for each in specs_along_axis(axis, "bc", spec).specs
    ]
    assert masses == [2.0, 5.0, 8.0]
    assert "max_turn_rate" not in parameters(spec, "body"), "its robots do not turn"
    with pytest.raises(UnknownNameError, match=r"body \(coop_nav\) parameter 'payload_mass'"):
        specs_along_axis(axis, "bc", TaskSpec())
    with pytest.raises(SpecError, match=r"such as max_acceleration=1\.5\.\.0\.5"):
        parse_axis("max_speed=fast", "body")


def test_the_trained_value_is_known() -> None:
    def trained(text: str, part: Part, spec: TaskSpec) -> float | None:
        return specs_along_axis(parse_axis(text, part), "bc", spec).trained

    assert trained("drop=0,1", "communication", TALKING) == 0.3
    assert trained("bandwidth=2,1", "communication", TALKING) is None
    assert trained("bursts.enter=0,0.1", "communication", TALKING) is None
    uneven = with_models(TaskSpec(), {"kind": "state", "noise": {"position": 0.1}})
    assert trained("noise=0,1", "observation", uneven) is None
    assert trained("noise=0,1", "observation", with_models(uneven, "=lidar+noise-0.1")) == 0.1
    lidar = with_models(TaskSpec(), "lidar-8")
    assert trained("range=2,1", "observation", lidar) == 2.0
    short = lidar.with_updates(team=(Role(robot=Robot(sensor_range=0.7)),))
    assert trained("range=2,1", "observation", short) == 0.7


def test_shorter_sight_of_a_lidar_loses_hits_and_keeps_the_unit() -> None:
    spec = with_models(TaskSpec(), "lidar-8")
    (near,) = specs_along_axis(Axis("observation", "range", (0.6,)), "bc", spec).specs
    views = []
    for each in (spec, near):
        env = make_env(each, 4)
        views.append(env.reset(evaluation_seeds(4)).observations[..., 5:].reshape(-1, 4))
    far, cut = views  # [beams, distance and three flags]
    is_near = far[:, 0] <= 0.6 / 2.0
    assert 0 < is_near.sum() < (far[:, 0] < 1.0).sum()
    np.testing.assert_array_equal(cut[is_near], far[is_near])
    assert (cut[~is_near] == np.array([1, 0, 0, 0])).all()  # nothing there


@pytest.mark.parametrize(
    ("text", "part", "spec", "message"),
    [
        ("drop=0,1", "communication", TaskSpec(), "without messages .* --communication perfect"),
        ("drpo=0,1", "communication", TALKING, "unknown .*broadcast.* Did you mean 'drop'"),
        ("n_rays=8,4", "observation", with_models(TaskSpec(), "lidar"), "Known: .*would misread"),
        ("n_nearest=2,1", "communication", TALKING, "unknown"),
        ("drop=0,1.5", "communication", TALKING, r"drop=0.0,1.5: .*at most 1 \(got"),
        ("delay=0,1.5", "communication", TALKING, "whole number"),
        ("noise=0,-1", "observation", TALKING, "expected at least 0"),
        ("range=4,1", "observation", with_models(TaskSpec(), "lidar"), "values up to 2"),
    ],
)
def test_what_cannot_be_swept_is_refused(
    text: str, part: Part, spec: TaskSpec, message: str
) -> None:
    with pytest.raises(SwarmdataError, match=message) as error:
        specs_along_axis(parse_axis(text, part), "runs/bc", spec)
    assert isinstance(error.value, SpecError | UnknownNameError)


def test_an_axis_without_contacts_has_no_friction() -> None:
    course = parse_axis("friction=0.2,1", "body")
    assert specs_along_axis(course, "bc", TaskSpec()).specs[0] == TaskSpec()
    with pytest.raises(SpecError, match=r"friction=0\.2,1\.0.*backend kinematic has no contacts"):
        specs_along_axis(course, "bc", TaskSpec(backend="kinematic"))


def test_a_value_of_an_axis_is_no_longer_drawn() -> None:
    ranges = {"mass": (1.0, 2.0), "noise": (0.0, 0.1), "drop_probability": (0.0, 0.5)}
    spec = TALKING.with_updates(randomization=ranges)
    cases: list[tuple[Part, str, str]] = [
        ("body", "mass=1,2", "mass"),
        ("observation", "noise=0,0.2", "noise"),
        ("observation", "noise.position=0,0.2", "noise"),
        ("communication", "drop=0,0.5", "drop_probability"),
    ]
    for part, text, name in cases:
        for found in specs_along_axis(parse_axis(text, part), "bc", spec).specs:
            assert found.randomization.ranges.keys() == ranges.keys() - {name}
    ranges = {"mass": (1.0, 2.0), "payload_mass": (2.0, 8.0), "payload_friction": (1.0, 4.0)}
    payload = preset("transport").with_updates(randomization=ranges)
    for name in ("payload_mass", "payload_friction"):
        for found in specs_along_axis(parse_axis(f"{name}=2,4", "body"), "bc", payload).specs:
            assert found.randomization.ranges.keys() == ranges.keys() - {name}
