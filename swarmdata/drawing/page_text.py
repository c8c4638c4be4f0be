"""Markdown pages: text that is kept, above tables and figures that a command makes again."""

from pathlib import Path

MADE = "<!-- What follows is made by swarmdata; what stands above this line is kept. -->"


def page_with(made: str, file: Path, title: str) -> str:
    """Returns a page whose tables and figures are new, and whose text is that of the file.

    Args:
        made: tables and figures.
        file: the page before; it need not exist. Where it has no line `MADE`, all of it is text.
        title: of a new page.
    """
    old = file.read_text(encoding="utf-8") if file.exists() else f"# {title}\n"
    return f"{old.partition(MADE)[0].rstrip()}\n\n{MADE}\n\n{made.strip()}\n"
