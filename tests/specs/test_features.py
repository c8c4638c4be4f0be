"""Names of features say which slot they belong to."""

import pytest

from swarmdata.specs.features import Feature, numbered, shown_for, telling_goals, vector


@pytest.mark.parametrize(
    ("name", "slot", "is_mask"),
    [
        ("neighbor_0.mask", "neighbor_0", True),
        ("neighbor_0.mask[-2]", "neighbor_0[-2]", True),
        ("neighbor_0.dx[-2]", "neighbor_0[-2]", False),
        ("own.masked", "own", False),
        ("role.mask_carrier", "role", False),
    ],
)
def test_slots_and_masks(name: str, slot: str, is_mask: bool) -> None:
    feature = Feature(name, "flag")
    assert (feature.slot, feature.is_mask) == (slot, is_mask)


def test_vectors_and_slots_are_named() -> None:
    fields = numbered("goal", 2, vector("offset", "position", "to it"))
    assert [f.name for f in fields] == [
        "goal_0.offset_x",
        "goal_0.offset_y",
        "goal_1.offset_x",
        "goal_1.offset_y",
    ]
    assert [f.axis for f in fields] == ["x", "y", "x", "y"]
    assert {f.meaning for f in fields} == {"to it"}


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("own.goal_dx", "own.shown_goal_dx"),
        ("corner_x", "shown_corner_x"),
        ("goal_2.is_taken", "goal_2.shown_is_taken"),
    ],
)
def test_what_tells_the_goal_is_renamed_where_it_is_hidden(name: str, shown: str) -> None:
    (feature,) = telling_goals([Feature(name, "flag", meaning="it")])
    assert shown_for(3, feature) == feature._replace(name=shown, meaning="it; 0 from step 3 on")
    assert shown_for(3, Feature(name, "flag")) == Feature(name, "flag")
