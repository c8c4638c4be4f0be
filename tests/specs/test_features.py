"""Names of features say which slot they belong to."""

import pytest

from swarmdata.specs.features import Feature


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
