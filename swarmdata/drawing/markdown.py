"""Small pieces of Markdown."""

import html
from collections.abc import Sequence


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; every cell is text, and nothing in it is HTML or ends the cell."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def _cell(text: str) -> str:
    """Names in a recipe come from outside: on a web page they must stay text."""
    return html.escape(" ".join(text.split()), quote=False).replace("|", "\\|")


def plain(value: object) -> str:
    """A value of a spec as text."""
    if isinstance(value, tuple):
        return ", ".join(plain(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else "none" if value is None else str(value)
