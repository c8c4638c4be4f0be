"""What messages advise: nothing is deleted that cannot be made again."""

import ast
import re

from tests.support.package_sources import sources

DELETION = re.compile(r"\b(delete|remove|erase|discard|rm|wipe)\b", re.IGNORECASE)

MADE_AGAIN = {
    "if that push is dead, delete {}/{}/{} and push again": "the mark of a push, without data",
    "Delete both, and make the part again": "parts of a recipe, which gives them again",
    "Delete it there, and run the share again": "a damaged part of a recipe, likewise",
    "remove the note to convert it as foreign data": "the same of other formats",
    "remove the key {} of its metadata.json to convert": "a note of ours; the episodes stay",
    "Pass --again to delete these cells and run them again": "cells that this command runs again",
}
"""The only messages that name a deletion, and why nothing is lost by it."""


class Strings(ast.NodeVisitor):
    """Collects the strings of a module, with {} for what is filled in; docstrings are none."""

    def __init__(self) -> None:
        self.found: set[str] = set()

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        parts = (str(p.value) if isinstance(p, ast.Constant) else "{}" for p in node.values)
        self.found.add("".join(parts))

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self.found.add(node.value)


def test_messages_advise_to_delete_only_what_is_made_again() -> None:
    strings = Strings()
    for text in filter(DELETION.search, sources().values()):
        strings.visit(ast.parse(text))
    advice = {text for text in strings.found if DELETION.search(text) and " " in text}
    unexplained = {text for text in advice if not any(known in text for known in MADE_AGAIN)}
    assert not unexplained
    for known in MADE_AGAIN:
        assert any(known in text for text in advice), f"no message says {known!r} any more"
