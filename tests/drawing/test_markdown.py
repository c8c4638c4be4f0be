"""Cells of a table are text, and columns of numbers are aligned to the right."""

from swarmdata.drawing.aligned_text import aligned_table
from swarmdata.drawing.markdown import plain, table


def test_a_table_aligns_numbers_to_the_right() -> None:
    assert table(("a", "b"), [("1", "2")]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
    numeric = table(("a", "b"), [("1", "2")], is_numeric=True)
    assert numeric == "| a | b |\n| --- | ---: |\n| 1 | 2 |\n"


def test_a_cell_cannot_end_itself_or_be_html() -> None:
    assert table(("a",), [("x|y\n<b>",)]).splitlines()[2] == "| x\\|y &lt;b&gt; |"


def test_aligned_columns_are_as_wide_as_their_widest_cell() -> None:
    shown = aligned_table(("name", "n"), [("a", "10"), ("long name", "2")])
    assert shown.splitlines() == ["name        n", "─" * 13, "a          10", "long name   2"]


def test_values_of_a_spec_are_text() -> None:
    assert (plain((1.50, "a")), plain(None)) == ("1.5, a", "none")
