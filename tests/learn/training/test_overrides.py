"""Overrides of algorithm configs from text."""

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.learn.training.settings import as_texts, from_json, override


@dataclass(frozen=True)
class Cost:
    weight: float = 1.0
    ramp: tuple[float, ...] = (0.0, 0.5)


@dataclass(frozen=True)
class Config:
    learning_rate: float = 1e-3
    n_updates: int = 10
    hidden: tuple[int, ...] = (64, 64)
    output: Literal["tanh", "clip"] = "tanh"
    clip_target: bool = True
    max_norm: float | None = None
    name: str = "x"
    cost: Cost = field(default_factory=Cost)


@pytest.mark.parametrize(
    ("field", "text", "value"),
    [
        ("learning_rate", "3e-4", 3e-4),
        ("n_updates", "500", 500),
        ("hidden", "32, 16", (32, 16)),
        ("hidden", "8", (8,)),
        ("output", "clip", "clip"),
        ("clip_target", "false", False),
        ("clip_target", "True", True),
        ("max_norm", "none", None),
        ("max_norm", "2", 2.0),
        ("name", "y", "y"),
    ],
)
def test_text_becomes_the_value_of_the_fields_type(field: str, text: str, value: Any) -> None:
    changed = getattr(override(Config(), {field: text}), field)
    assert changed == value
    assert type(changed) is type(value)


def test_an_unknown_field_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match=r"'learning_rat'.*Did you mean 'learning_rate'"):
        override(Config(), {"learning_rat": "1"})


@pytest.mark.parametrize(
    ("field", "text", "expected"),
    [
        ("n_updates", "1.5", "a whole number"),
        ("learning_rate", "fast", "a finite number"),
        ("learning_rate", "nan", "a finite number"),
        ("output", "relu", "one of 'tanh', 'clip'"),
        ("clip_target", "2", "true or false"),
        ("hidden", "64,x", "values separated by commas, each a whole number"),
        ("max_norm", "lots", "a finite number or none"),
    ],
)
def test_text_of_another_type_is_refused(field: str, text: str, expected: str) -> None:
    with pytest.raises(SpecError) as caught:
        override(Config(), {field: text})
    assert f"setting {field!r} of Config got {text!r}, expected {expected}" in str(caught.value)


def test_settings_of_a_section_are_named_after_it() -> None:
    changed = override(Config(cost=Cost(ramp=(0.1, 0.2))), {"cost.weight": "3", "name": "y"})
    assert changed == Config(name="y", cost=Cost(3.0, (0.1, 0.2)))
    with pytest.raises(UnknownNameError, match=r"'weight'.*Did you mean 'cost.weight'"):
        override(Config(), {"weight": "3"})
    with pytest.raises(UnknownNameError, match=r"unknown setting 'cost'"):
        override(Config(), {"cost": "3"})


def test_tables_are_settings_as_the_command_line_takes_them() -> None:
    table = {"hidden": [8, 16], "clip_target": False, "max_norm": None, "cost": {"ramp": [0, 1.5]}}
    texts = as_texts(table)
    assert texts == {
        "hidden": "8,16", "clip_target": "false", "max_norm": "none", "cost.ramp": "0,1.5",
    }  # fmt: skip
    changed = override(Config(max_norm=1.0), texts)
    assert changed == Config(hidden=(8, 16), clip_target=False, cost=Cost(ramp=(0.0, 1.5)))


def test_a_config_survives_json() -> None:
    config = Config(hidden=(3,), max_norm=0.1, cost=Cost(0.3, (-1.0, 2.0)))
    assert from_json(Config, json.loads(json.dumps(dataclasses.asdict(config)))) == config
    with pytest.raises(UnknownNameError, match=r"'cost.wait'.*Did you mean 'cost.weight'"):
        from_json(Config, {"cost": {"wait": 1.0}})
