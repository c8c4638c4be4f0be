"""Ranges of a spec: what may be drawn, how it is written, what is refused."""

import json
from typing import Any

import pytest

from swarmdata.errors import SpecError
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.randomization import (
    BODY_RANGES,
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
    drawn = TaskSpec.parse({"randomization": {"mass": [1, 2], "command_delay": [0, 3]}})
    assert TaskSpec.from_text(drawn.to_yaml()) == drawn
    assert drawn.randomization.ranges == {"mass": (1.0, 2.0), "command_delay": (0, 3)}


def test_a_range_may_begin_at_zero_and_have_no_width() -> None:
    found = Randomization(actuator_lag=(0.0, 0.0), noise=(0.1, 0.1)).ranges
    assert found == {"actuator_lag": (0.0, 0.0), "noise": (0.1, 0.1)}


def test_ranges_of_bodies_are_fields_of_robots() -> None:
    assert set(BODY_RANGES) <= set(Robot.model_fields)
    assert set(RANDOM_FIELDS) - set(BODY_RANGES) == {"noise", *TEAM_RANGES}
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
    assert with_models(spec) == spec
    assert with_models(spec, randomization={}) == TaskSpec()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"randomization": {"mass": [2, 1]}}, "begins above its end"),
        ({"randomization": {"mass": [0, 1]}}, "mass"),
        ({"randomization": {"command_delay": [0, 1.5]}}, "command_delay"),
        ({"randomization": {"radius": [0.1, 0.2]}}, "radius"),
        ({"randomization": {"wheel_grip": [1, 2]}}, "of unicycles, but no robot is one"),
        ({"randomization": {"max_turn_rate": [1, 2]}}, "of unicycles, but no robot is one"),
        ({"randomization": {"drop_probability": [0, 0.5]}}, "needs messages, got communication"),
        ({"randomization": {"friction": [0, 1]}, "backend": "kinematic"}, "has no contacts"),
        ({"randomization": {"payload_mass": [1, 2]}}, "needs a payload, got task coop_nav"),
        (
            {
                "rules": {"task": "transport"},
                "randomization": {"payload_friction": [1, 2]},
                "backend": "kinematic",
            },
            "payload_friction has no effect in backend kinematic",
        ),
        (
            {"rules": {"task": "transport"}, "randomization": {"payload_friction": [0, 2]}},
            "payload_friction",
        ),
    ],
)
def test_what_nothing_has_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        TaskSpec.parse(fields)
