"""Text of the code as Markdown: docstrings, and what is said beside the fields of a class."""

import ast
import inspect
import re
import tokenize
from functools import cache
from io import StringIO
from itertools import zip_longest
from typing import Any

LABEL = re.compile(r"[A-Z]\w+: ")  # a paragraph that a docstring does not set apart, as `Action: `


def markdown_of(text: str) -> str:
    """A docstring as Markdown: indented formulas become blocks, asterisks and `<` stay text."""
    lines: list[str] = []
    for line in inspect.cleandoc(text).splitlines():
        is_code = line.startswith("    ")
        if LABEL.match(line) and lines and lines[-1]:
            lines.append("")
        lines.append(line if is_code else _plain(line))
    return "\n".join(lines) + "\n"


def summary_of(text: str | None) -> str:
    """The first sentence of a docstring, on one line."""
    first = inspect.cleandoc(text or "").split("\n\n")[0]
    return _plain(" ".join(first.split()))


def field_notes(owner: type[Any]) -> dict[str, str]:
    """What the comment behind each field of a class says, or the text below it; bases included."""
    notes: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        if not base.__module__.startswith("swarmdata."):
            continue
        own = _own_notes(base)
        notes |= {name: note for name, note in own.items() if note or name not in notes}
    return notes


@cache
def _own_notes(owner: type[Any]) -> dict[str, str]:
    source = inspect.cleandoc("\n" + inspect.getsource(owner))
    comments = {
        token.start[0]: token.string.lstrip("# ").strip()
        for token in tokenize.generate_tokens(StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    return {
        node.target.id: comments.get(node.end_lineno or 0, "") or _literal(following)
        for node, following in zip_longest(body.body, body.body[1:])
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }


def _literal(node: ast.stmt | None) -> str:
    """The text of a string that stands alone, below a field that has no room for a comment."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        text = str(node.value.value).rstrip(".")
        return text[:1].lower() + text[1:]  # as comments begin
    return ""


def _plain(line: str) -> str:
    parts = re.split(r"(`[^`]*`)", line)
    return "".join(
        part if part.startswith("`") else part.replace("*", r"\*").replace("<", "&lt;")
        for part in parts
    )
