"""Search spaces: what is drawn lies in them, and fills them."""

import math
from itertools import islice

import pytest

from swarmdata.errors import SchemaError
from swarmdata.learn.training.settings import Choice, LogUniform, Space, drawn_settings, space_of

SPACE: Space = {"rate": LogUniform(1e-4, 1e-2), "kind": Choice(("a", "b", "c"))}


def test_draws_lie_in_the_space_and_fill_it() -> None:
    found = list(islice(drawn_settings(SPACE, 0), 300))
    assert all(each[name] in SPACE[name] for each in found for name in SPACE)
    below = sum(each["rate"] < 1e-3 for each in found)  # half of the logarithms
    assert abs(below - 150) < 4 * math.sqrt(300) / 2
    counts = [sum(each["kind"] == kind for each in found) for kind in "abc"]
    assert min(counts) > 70
    assert len({each["rate"] for each in found}) > 200


def test_more_trials_begin_with_the_same_ones_and_other_seeds_differ() -> None:
    assert (
        list(islice(drawn_settings(SPACE, 0), 3)) == list(islice(drawn_settings(SPACE, 0), 9))[:3]
    )
    assert next(drawn_settings(SPACE, 0)) != next(drawn_settings(SPACE, 1))


def test_numbers_are_short_and_reach_the_ends() -> None:
    space = LogUniform(0.12345, 1.2345)
    assert space.at(0.0) == 0.12345  # rounded, it would be below
    assert space.at(0.5) == 0.39
    assert 0.1 not in space
    assert 1.2345 in space


@pytest.mark.parametrize("ends", [(0.0, 1.0), (2.0, 1.0), (1.0, 1.0), (1.0, math.inf)])
def test_ends_that_are_no_interval_are_refused(ends: tuple[float, float]) -> None:
    with pytest.raises(SchemaError, match="ends above 0"):
        LogUniform(*ends)


def test_an_algorithm_without_a_space_says_how_to_declare_one() -> None:
    with pytest.raises(SchemaError, match=r"mine declares no search space.*SPACE"):
        space_of(object, "mine")
