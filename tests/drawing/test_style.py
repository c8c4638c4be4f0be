"""One look for each label: families by color, members by marker."""

from swarmdata.drawing.style import COLORS, MARKERS, family_looks


def test_members_of_a_family_share_a_color_and_no_two_labels_look_alike() -> None:
    families = {f"row_{k}": f"family {k % 8}" for k in range(40)}
    looks = family_looks(families)
    assert len({tuple(look.values()) for look in looks.values()}) == 40
    assert looks["row_0"]["color"] == looks["row_8"]["color"] == COLORS[0]
    assert looks["row_0"]["marker"] == MARKERS[0]
    assert looks["row_6"]["color"] == COLORS[0], "colors repeat, markers do not"
    assert list(looks) == list(families)
