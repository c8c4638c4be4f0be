"""Names of features say which slot they belong to."""

import pytest

from swarmdata.specs.features import Feature, numbered, vector


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
