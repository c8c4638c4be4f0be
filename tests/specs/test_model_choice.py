"""Models by name in a spec, their identity and words, and who can act with them."""

import json
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.model_choice import (
    check_senses,
    chosen_models,
    describe,
    is_same_world,
    models_of,
    with_models,
)
from swarmdata.specs.sensing_models import Broadcast, LidarModel
from swarmdata.specs.task_spec import TaskSpec

OBSERVATIONS = st.sampled_from(
    ["state", "lidar-8", "bearing", "occupancy+delay-1", "lidar+stack-2"]
)
COMMUNICATIONS = st.sampled_from(["none", "perfect", "lossy-30", "learned-2", "aloha-4+range-1"])


def check(trained: TaskSpec, offered: TaskSpec) -> None:
    features = (features_of(make_task(spec)) for spec in (trained, offered))
    check_senses("bc", trained, offered, *features)


def test_names_fields_and_models_mean_the_same() -> None:
    spec = with_models(TaskSpec(), "lidar-8", {"kind": "broadcast", "drop_probability": 0.3})
    assert spec.observation == LidarModel(n_rays=8)
    assert spec.communication == Broadcast(drop_probability=0.3)
    assert with_models(TaskSpec(), LidarModel(n_rays=8), "lossy-30") == spec
    assert with_models(spec) is spec
    assert with_models(spec, communication="none").observation == spec.observation
    with pytest.raises(UnknownNameError, match="Did you mean 'lidar'"):
        with_models(spec, "lidra")


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ({"observation": "lossy-130"}, r"'lossy-130' .* observation model, .* \(--communication"),
        ({"observation": "lossy-3+range-1"}, "is one for communication"),
        ({"communication": "lidar-8"}, r"'lidar-8' .* communication model, .* \(--observation"),
        ({"communication": "lidra"}, None),
        ({"observation": "losy-30"}, None),
    ],
)
def test_a_model_of_the_other_kind_is_refused_as_such(
    models: dict[str, str], message: str | None
) -> None:
    """What is of neither kind is an unknown name."""
    with pytest.raises(UnknownNameError if message is None else SpecError, match=message):
        with_models(TaskSpec(), **models)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", preset_names())
def test_modifiers_of_strength_zero_change_no_preset(name: str) -> None:
    spec = preset(name)
    for text in ("noise-0", "dropout-0", "delay-0", "noise-0+dropout-0", spec.observation.kind):
        assert with_models(spec, observation=text) == spec, text
    if isinstance(spec.communication, Broadcast):
        for text in ("lossy-0", "bursty-0", "delayed-0", "lossy-0+delayed-0"):
            assert with_models(spec, communication=text) == spec, text


def test_names_modify_the_tasks_own_models_and_not_those_of_a_view() -> None:
    own = preset("search-hard")
    seen = with_models(own, "lidar+noise-0.1", "lossy-50+delayed-2")
    again = with_models(seen, communication="lossy-50", own=own)
    assert again.observation == seen.observation
    assert again.communication == own.communication.model_copy(update={"drop_probability": 0.65})
    assert with_models(seen, "state", "goal", own=own) == own


def test_noise_and_losses_that_are_chosen_are_drawn_no_more(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ranges = {"mass": (1.0, 2.0), "noise": (0.0, 0.1), "drop_probability": (0.0, 0.3)}
    drawn = with_models(preset("search"), randomization=ranges)
    assert with_models(drawn, "lidar+delay-1", "goal").randomization == drawn.randomization
    with caplog.at_level(logging.INFO, "swarmdata"):
        found = chosen_models(drawn, "noise-0.2", "lossy-60")
    assert found.randomization.ranges == {"mass": (1.0, 2.0)}
    assert "randomization.noise (0.0, 0.1) -> none" in caplog.text
    assert drawn.with_updates(observation="noise-0.2", communication="lossy-60") == found
    assert with_models(drawn, "noise-0.2", randomization=ranges).randomization.ranges == ranges
    assert is_same_world(drawn, found)
    assert is_same_world(found, drawn)


@pytest.mark.parametrize(
    ("chosen", "line"),
    [
        (("noise-0.02", None), "observation.noise.position 0 -> 0.02, observation.noise.velocity"),
        (
            ("lidar-8", None),
            "observation state (ways True, limit 1) -> lidar (ways True, n_rays 8)",
        ),
        ((None, "lossy-50+range-2"), "communication.range none -> 2, communication.drop_pro"),
        ((None, "none"), "communication broadcast (payload pose_and_goal) -> none"),
        ((None, "goal+lossy-0"), "none"),
    ],
)
def test_one_line_names_every_field_that_a_choice_changes(
    chosen: tuple[str | None, str | None], line: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "swarmdata"):
        found = chosen_models(preset("search"), *chosen)
        assert found == with_models(preset("search"), *chosen)
        assert chosen_models(found) == found, "says nothing"
    (said,) = [record.message for record in caplog.records]
    assert said.startswith(f"Changes to the task's own models: {line}")


@given(OBSERVATIONS, COMMUNICATIONS, st.integers(20, 40))
def test_models_survive_json_and_leave_the_world(
    observation: str, communication: str, horizon: int
) -> None:
    base = TaskSpec(horizon=horizon)
    spec = with_models(base, observation, communication)
    assert with_models(base, **json.loads(json.dumps(models_of(spec)))) == spec
    assert is_same_world(spec, base)
    assert not is_same_world(spec, TaskSpec(horizon=horizon + 1))
    check(spec, spec)


@pytest.mark.parametrize(
    ("trained", "offered"),
    [
        (("state", "none"), ("state+noise-0.1+dropout-0.5", "none")),
        (("lidar", "perfect"), ("lidar+range-1", "bursty-20+range-1.5")),
    ],
)
def test_worse_models_of_the_same_features_are_accepted(
    trained: tuple[str, str], offered: tuple[str, str]
) -> None:
    check(with_models(TaskSpec(), *trained), with_models(TaskSpec(), *offered))


@pytest.mark.parametrize(
    ("trained", "offered", "message"),
    [
        (("state", "none"), ("lidar", "none"), r"53 numbers .* number 0 is own\.\w+, not own\.x"),
        (("lidar", "none"), ("lidar", "perfect"), r"number 69 is message_0\.\w+, not nothing"),
        (("lidar+stack-2", "none"), ("lidar", "none"), r"is nothing, not own\.v_x\[-1\]"),
        (("state", "learned-2"), ("state", "learned-3"), r"actions of 4\. .*actions of 5"),
    ],
)
def test_other_features_are_refused_with_the_models_it_was_trained_with(
    trained: tuple[str, str], offered: tuple[str, str], message: str
) -> None:
    with pytest.raises(SchemaError, match=message) as error:
        check(with_models(TaskSpec(), *trained), with_models(TaskSpec(), *offered))
    assert f"bc was trained with {describe(with_models(TaskSpec(), *trained))}" in str(error.value)
