"""Tables for a terminal: columns aligned with spaces."""

from collections.abc import Sequence


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
