"""Cells of a table are text, and columns of numbers are aligned to the right."""

import pytest

from swarmdata.drawing.markdown import aligned_table, plain, table


def test_a_table_aligns_numbers_to_the_right() -> None:
    assert table(("a", "b"), [("1", "2")]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
    numeric = table(("a", "b"), [("1", "2")], is_numeric=True)
    assert numeric == "| a | b |\n| --- | ---: |\n| 1 | 2 |\n"


@pytest.mark.parametrize(
    ("cell", "shown"),
    [
        ("x|y\n<b>", "x\\|y &lt;b&gt;"),
        ("`-w * [a > b] * |c|`", "`-w * [a > b] * \\|c\\|`"),
        ("a < b: `c < d`", "a &lt; b: `c < d`"),
        ("`<b>``", "`&lt;b&gt;``"),
        ("``<b>`", "``&lt;b&gt;`"),
        ("` <b>", "` &lt;b&gt;"),
    ],
)
def test_cells_stay_cells_of_text_and_code_keeps_its_marks(cell: str, shown: str) -> None:
    assert table(("a",), [(cell,)]).splitlines()[2] == f"| {shown} |"


def test_aligned_columns_are_as_wide_as_their_widest_cell() -> None:
    shown = aligned_table(("name", "n"), [("a", "10"), ("long name", "2")])
    assert shown.splitlines() == ["name        n", "─" * 13, "a          10", "long name   2"]


def test_values_of_a_spec_are_text() -> None:
    assert (plain((1.50, "a")), plain(None)) == ("1.5, a", "none")
