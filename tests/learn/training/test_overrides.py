"""Overrides of algorithm configs from text."""

from dataclasses import dataclass
from typing import Any, Literal

import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.learn.training.overrides import override


@dataclass(frozen=True)
class Config:
    step_size: float = 1e-3
    n_updates: int = 10
    hidden: tuple[int, ...] = (64, 64)
    output: Literal["tanh", "clip"] = "tanh"
    clip_target: bool = True
    max_norm: float | None = None
    name: str = "x"


@pytest.mark.parametrize(
    ("field", "text", "value"),
    [
        ("step_size", "3e-4", 3e-4),
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


def test_other_fields_keep_their_values() -> None:
    config = Config(n_updates=7)
    assert override(config, {"name": "y"}) == Config(n_updates=7, name="y")
    assert config.name == "x"


def test_an_unknown_field_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match=r"'step_sise'.*Did you mean 'step_size'"):
        override(Config(), {"step_sise": "1"})


@pytest.mark.parametrize(
    ("field", "text", "expected"),
    [
        ("n_updates", "1.5", "a whole number"),
        ("step_size", "fast", "a finite number"),
        ("step_size", "nan", "a finite number"),
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
