"""Gymnasium's spaces and ours."""

import pytest
from gymnasium.spaces import MultiDiscrete, Text
from hypothesis import given

from swarmdata.errors import SpecError
from swarmdata.specs.spaces import Space, space_of, to_gymnasium
from tests.interop.conversion.test_space_columns import Spaces


@given(Spaces)
def test_spaces_survive(space: Space) -> None:
    assert space_of(to_gymnasium(space), "it") == space


def test_what_has_no_fixed_size_is_refused() -> None:
    with pytest.raises(SpecError, match=r"action of a is Text.* expected Box"):
        space_of(Text(3), "action of a")
    with pytest.raises(SpecError, match="must start at 0"):
        space_of(MultiDiscrete([2, 2], start=[1, 0]), "action of a")
