"""One look for each label: families by color, members by marker; labels at lines stay apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.drawing.line_labels import spread_labels
from swarmdata.drawing.style import (
    COLORS,
    FAMILY_COLORS,
    FAMILY_OF,
    GRAY,
    MARKERS,
    SPARE_COLORS,
    family_looks,
    line_looks,
    words_of,
    words_of_pair,
)


def test_members_of_a_family_share_a_color_and_no_two_labels_look_alike() -> None:
    families = {f"row_{k}": f"family {k % 10}" for k in range(40)}
    looks = family_looks(families)
    assert len({tuple(look.values()) for look in looks.values()}) == 40
    assert looks["row_0"]["color"] == looks["row_10"]["color"] == SPARE_COLORS[0]
    assert looks["row_0"]["marker"] == MARKERS[0]
    assert looks["row_9"]["color"] == COLORS[3], "colors repeat, markers do not"
    assert list(looks) == list(families)


def test_a_family_has_one_color_and_an_algorithm_one_marker_in_all_figures() -> None:
    assert len({*FAMILY_COLORS.values()}) == len(FAMILY_COLORS)
    one = family_looks({"new": "something new", "bc": "cloning", "qmix-bc": "value decomposition",
                        "qmix": "value decomposition", "cut": "ablations"})  # fmt: skip
    other = family_looks({"qmix": "qmix", "bc": "bc", "bc-gru": "recurrent cloning"})
    assert one["bc"] == other["bc"]
    assert one["qmix"] == other["qmix"], "whatever stands before it"
    assert one["qmix-bc"]["color"] == one["qmix"]["color"]
    assert one["qmix-bc"]["marker"] != one["qmix"]["marker"]
    assert one["cut"]["color"] == GRAY
    assert one["new"]["color"] not in FAMILY_COLORS.values()
    assert other["bc-gru"]["color"] == other["bc"]["color"]
    assert other["bc-gru"]["marker"] != other["bc"]["marker"]
    looks = family_looks({name: name for name in FAMILY_OF})
    assert len({tuple(look.values()) for look in looks.values()}) == len(FAMILY_OF)


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("bc", "bc"),
        ("bc-4x", "bc, 4 × updates"),
        ("iql-fast-2x", "iql, fast critics, 2 × updates"),
        ("vdn-without", "vdn ablated"),
        ("maddpg_bc-decentralized", "maddpg_bc, local critics"),
    ],
)
def test_labels_of_studies_are_shown_as_words(label: str, words: str) -> None:
    assert words_of(label) == words


def test_a_pair_says_once_what_both_begin_with() -> None:
    assert words_of_pair("iql-fast-2x", "iql-fast-1x") == ("iql, fast critics: 2 × − 1 × updates")
    assert words_of_pair("filtered_bc", "bc") == "filtered_bc − bc"
    assert words_of_pair("iql", "iql-without") == "iql − ablated"


def test_lines_of_a_color_differ_in_their_dashes() -> None:
    looks = family_looks(dict.fromkeys(("a", "b", "c"), "cloning"))
    lines = line_looks(looks)
    assert len({line["color"] for line in lines.values()}) == 1
    assert len({str(line["ls"]) for line in lines.values()}) == 3


@given(st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=9), st.floats(0.01, 0.1))
def test_labels_stay_apart_and_in_order(wanted: list[float], gap: float) -> None:
    ends = np.array(wanted)
    places = spread_labels(ends, gap)
    order = np.argsort(ends, kind="stable")
    assert (np.diff(places[order]) >= gap - 1e-9).all()
    assert places.min() >= -1e-9
    assert places.max() <= 1.0 + 1e-9


def test_labels_with_room_stay_where_they_are() -> None:
    np.testing.assert_allclose(spread_labels(np.array([0.9, 0.1, 0.5]), 0.1), [0.9, 0.1, 0.5])
    np.testing.assert_allclose(spread_labels(np.array([0.5, 0.5]), 0.1), [0.45, 0.55])
