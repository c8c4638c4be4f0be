"""Communication models from names, text and files."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.sensing_models import Broadcast, Bursts, NoCommunication

PARTS: dict[str, dict[str, Any]] = {
    "goal": {"payload": "pose_and_goal"},
    "errand": {"payload": "errand"},
    "state": {"payload": "state"},
    "learned-4": {"payload": "learned", "message_size": 4},
    "nearest-2": {"topology": "nearest", "n_nearest": 2},
    "ring": {"topology": "ring"},
    "star": {"topology": "star"},
    "range-1.5": {"range": 1.5},
    "lossy-30": {"drop_probability": 0.3},
    "lossy-12.3": {"drop_probability": 0.123},
    "aloha-8": {"slots_in_step": 8},
    "bandwidth-1": {"messages_per_step": 1},
    "bits-8": {"bits": 8},
    "delayed-2": {"delay": 2},
    "expires-5": {"max_age": 5},
}


@given(st.lists(st.sampled_from(sorted(PARTS)), min_size=1, unique=True))
def test_names_set_their_fields_or_contradict_each_other(parts: list[str]) -> None:
    fields = [name for part in parts for name in PARTS[part]]
    text = "+".join(parts)
    if len(set(fields)) < len(fields):
        with pytest.raises(SpecError, match="both set"):
            communication_model(text)
    else:
        expected = Broadcast(**{k: v for part in parts for k, v in PARTS[part].items()})
        assert communication_model(text) == expected


OWN = Broadcast(payload="pose_and_goal", range=2.0, drop_probability=0.3, delay=1)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("lossy-50", {"drop_probability": 0.65}),
        ("delayed-2", {"delay": 3}),
        ("range-1.5+bandwidth-1", {"range": 1.5, "messages_per_step": 1}),
        ("state", {"payload": "state"}),
        ("lossy-0", {}),
        ("delayed-0", {}),
        ("bursty-0", {}),
    ],
)
def test_names_modify_the_model_of_a_task(name: str, changes: dict[str, Any]) -> None:
    assert communication_model(name, OWN) == OWN.model_copy(update=changes)
    assert communication_model(f"={name}", OWN) == communication_model(name)
    assert communication_model(name, NoCommunication()) == communication_model(name)


def test_names_that_contradict_the_model_of_a_task_are_refused() -> None:
    with pytest.raises(SpecError, match=r"'expires-1'.* forgets messages before they arrive"):
        communication_model("expires-1", Broadcast(delay=2))


@pytest.mark.parametrize("percent", [10, 30, 80])
def test_bursts_lose_their_share_in_the_long_run(percent: int) -> None:
    model = communication_model(f"bursty-{percent}")
    assert isinstance(model, Broadcast)
    assert isinstance(model.bursts, Bursts)
    enter, leave = model.bursts.enter, model.bursts.leave
    assert (enter / (enter + leave), leave) == pytest.approx((percent / 100, 0.25))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("losy-30", "unknown communication model 'losy-30'. Did you mean 'lossy-30'?"),
        ("lossy-30+", "unknown communication model ''. Known: "),
        ("{kind: brodcast}", "unknown communication model 'brodcast'. Did you mean 'broadcast'?"),
        ("lossy", "'lossy' is not a number, got nothing. Expected something like lossy-30"),
        ("lossy-130", "is not a percentage between 0 and 100, got '130'"),
        ("bursty-90", "is more than the 80.0 percent that bursts of 4 steps can lose, got '90'"),
        ("delayed--1", "is not a whole number, got '-1'"),
        ("expires-254", "max_age: expected at most 253 (got 254)"),
        ("delayed-5+expires-4", "max_age 4 forgets messages before they arrive, 5 steps after"),
        ("range-inf", "range: expected a finite number"),
        ("ring-3", "'ring' takes no value, got 'ring-3'"),
        ("none+lossy-30", "'none' stands alone"),
        ("ring+star", "'ring' and 'star' both set topology"),
        ("{kind: broadcast, dely: 2}", "Did you mean 'delay'?"),
        ("nowhere/channel.yaml", "cannot read the communication model 'nowhere/channel.yaml'"),
    ],
)
def test_what_is_wrong_is_said(text: str, message: str) -> None:
    expected = UnknownNameError if message.startswith("unknown") else SpecError
    with pytest.raises(expected) as caught:
        communication_model(text)
    assert message in str(caught.value)


def test_every_form_of_a_model_gives_that_model(tmp_path: Path) -> None:
    model = communication_model("lossy-30+delayed-2+range-1.5+bursty-10")
    file = tmp_path / "channel.yaml"
    file.write_text(model.to_yaml(), encoding="utf-8")

    for form in (model, model.model_dump(), model.to_json(), model.to_yaml(), file, str(file)):
        assert communication_model(form) == model
    assert communication_model({"kind": "none"}) == NoCommunication()
