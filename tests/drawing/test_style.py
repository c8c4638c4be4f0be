"""One look for each label: families by color, members by marker."""

from swarmdata.drawing.style import COLORS, FAMILY_COLORS, MARKERS, family_looks, line_looks


def test_members_of_a_family_share_a_color_and_no_two_labels_look_alike() -> None:
    families = {f"row_{k}": f"family {k % 8}" for k in range(40)}
    looks = family_looks(families)
    assert len({tuple(look.values()) for look in looks.values()}) == 40
    assert looks["row_0"]["color"] == looks["row_8"]["color"] == COLORS[0]
    assert looks["row_0"]["marker"] == MARKERS[0]
    assert looks["row_6"]["color"] == COLORS[0], "colors repeat, markers do not"
    assert list(looks) == list(families)


def test_known_families_have_the_same_color_in_all_studies() -> None:
    one = family_looks({"a": "something new", "bc": "cloning", "iql": "in-sample"})
    other = family_looks({"iql": "in-sample", "bc": "cloning"})
    assert one["bc"] == other["bc"]
    assert one["iql"]["color"] == other["iql"]["color"] == FAMILY_COLORS["in-sample"]
    assert one["a"]["color"] not in {one["bc"]["color"], one["iql"]["color"]}


def test_lines_of_a_color_differ_in_their_dashes() -> None:
    looks = family_looks(dict.fromkeys(("a", "b", "c"), "cloning"))
    lines = line_looks(looks)
    assert len({line["color"] for line in lines.values()}) == 1
    assert len({str(line["ls"]) for line in lines.values()}) == 3
