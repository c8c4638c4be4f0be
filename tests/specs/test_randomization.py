"""Ranges of a spec: what may be drawn, how it is written, what is refused."""

import json

import pytest

from swarmdata.errors import SpecError
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.randomization import (
    PAYLOAD_RANGES,
    RANDOM_FIELDS,
    TEAM_RANGES,
    Randomization,
)
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import Robot, TaskSpec


def test_no_range_is_not_written_and_keeps_the_hash() -> None:
    assert "randomization" not in json.loads(TaskSpec().to_json())
    assert TaskSpec.parse({"randomization": {}}).hash() == TaskSpec().hash()
    ranges = {"mass": (1.0, 2.0), "command_delay": (0, 3), "actuator_lag": (0.0, 0.0)}
    drawn = TaskSpec.parse({"randomization": ranges})
    assert TaskSpec.from_text(drawn.to_yaml()) == drawn
    assert drawn.randomization.ranges == ranges


def test_ranges_of_bodies_are_fields_of_robots() -> None:
    assert set(RANDOM_FIELDS[:8]) <= set(Robot.model_fields)
    assert set(RANDOM_FIELDS) - set(RANDOM_FIELDS[:8]) == {"noise", *TEAM_RANGES}
    assert set(PAYLOAD_RANGES) < set(TEAM_RANGES)
    assert set(PAYLOAD_RANGES.values()) <= set(Payload.model_fields)


def test_new_fields_come_last() -> None:
    """Draws depend on the index of a field, and recorded episodes must keep theirs."""
    assert RANDOM_FIELDS == (
        "max_speed", "max_acceleration", "max_turn_rate", "mass", "friction", "wheel_grip",
        "command_delay", "actuator_lag", "noise", "drop_probability", "payload_mass",
        "payload_friction",
    )  # fmt: skip


def test_the_largest_value_is_that_of_any_episode() -> None:
    spec = TaskSpec.parse({"randomization": {"max_speed": [0.3, 0.9]}})
    assert spec.largest("max_speed") == (0.9,) * 4
    assert spec.largest("mass") == (1.0,) * 4


def test_ranges_are_replaced_and_taken_away() -> None:
    spec = with_models(TaskSpec(), randomization={"mass": (1.0, 2.0)})
    assert spec.randomization == Randomization(mass=(1.0, 2.0))
    assert with_models(spec, randomization={}) == TaskSpec()


KINEMATIC_LOAD = "payload_friction: [1, 2]}, rules: {task: transport}, backend: kinematic"


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ("mass: [2, 1]}", "begins above its end"),
        ("mass: [0, 1]}", "mass"),
        ("command_delay: [0, 1.5]}", "command_delay"),
        ("radius: [0.1, 0.2]}", "radius"),
        ("wheel_grip: [1, 2]}", "of unicycles, but no robot is one"),
        ("max_turn_rate: [1, 2]}", "of unicycles, but no robot is one"),
        ("drop_probability: [0, 0.5]}", "needs messages, got communication"),
        ("friction: [0, 1]}, backend: kinematic", "has no contacts"),
        ("payload_mass: [1, 2]}", "needs a payload, got task coop_nav"),
        (KINEMATIC_LOAD, "payload_friction has no effect in backend kinematic"),
        ("payload_friction: [0, 2]}, rules: {task: transport}", "payload_friction"),
    ],
)
def test_what_nothing_has_is_refused(ranges: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        TaskSpec.from_text(f"{{randomization: {{{ranges}}}")
