"""Models by name in a spec, their identity and words, and who can act with them."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.model_choice import (
    check_senses,
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


def test_words_say_what_is_not_a_default() -> None:
    assert describe(TaskSpec()) == "observation state, communication none"
    spec = with_models(TaskSpec(), "lidar-8+noise-0.05", "lossy-30+delayed-2")
    assert describe(spec) == (
        "observation lidar "
        "(noise position 0.05 velocity 0.05 direction 0.05 range 0.05, n_rays 8), "
        "communication broadcast (drop_probability 0.3, delay 2)"
    )


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
