"""Markdown tables, and values of a spec as text."""

import html
import re
from collections.abc import Iterable, Mapping, Sequence

_CODE = re.compile(r"((?<!`)`[^`]+`(?!`))")  # text in which Markdown reads no marks and no HTML


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, is_numeric: bool = False) -> str:
    """A GitHub table whose cells stay text or `code`: no HTML, no line breaks, no end of the cell.

    If it `is_numeric`, every column but the first is aligned to the right.
    """
    rule = ["---", *["---:" if is_numeric else "---"] * (len(head) - 1)]
    lines = [head, rule, *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def pivot(corner: str, columns: Iterable[str], cells: Mapping[tuple[str, str], str]) -> str:
    """A table with a row for each first key of `cells`, as code; what it lacks is a dash."""
    heads, rows = tuple(columns), dict.fromkeys(row for row, _ in cells)
    body = [(f"`{row}`", *(cells.get((row, head), "–") for head in heads)) for row in rows]
    return table((corner, *heads), body)


def _cell(text: str) -> str:
    """Names in a recipe come from outside: on a web page they must stay text."""
    parts = _CODE.split(" ".join(text.split()))
    escaped = (part if _CODE.fullmatch(part) else html.escape(part, quote=False) for part in parts)
    return "".join(escaped).replace("|", "\\|")


def plain(value: object) -> str:
    """A value of a spec as text."""
    if isinstance(value, tuple):
        return ", ".join(plain(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else "none" if value is None else str(value)


def aligned_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a rule under its head: the first column to the left, the others to the right."""
    grid = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*grid, strict=True)]
    lines = [
        "  ".join(
            cell.rjust(width) if index else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in grid
    ]
    rule = "─" * (sum(widths) + 2 * len(widths) - 2)
    return "\n".join([lines[0], rule, *lines[1:], ""])
