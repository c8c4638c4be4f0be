"""Markdown tables, and values of a spec as text."""

import html
from collections.abc import Sequence


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, is_numeric: bool = False) -> str:
    """A GitHub table whose cells stay text: no HTML, no line breaks, no end of the cell.

    Args:
        head: the first line.
        rows: as long as the head.
        is_numeric: whether every column but the first is aligned to the right.
    """
    rule = ["---", *["---:" if is_numeric else "---"] * (len(head) - 1)]
    lines = [head, rule, *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def _cell(text: str) -> str:
    """Names in a recipe come from outside: on a web page they must stay text."""
    return html.escape(" ".join(text.split()), quote=False).replace("|", "\\|")


def plain(value: object) -> str:
    """A value of a spec as text."""
    if isinstance(value, tuple):
        return ", ".join(plain(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else "none" if value is None else str(value)
