"""docs/faults.md names every fault, and docs/fault-tests.md only tests that exist."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/faults.md").read_text(encoding="utf-8")
TESTS = (ROOT / "docs/fault-tests.md").read_text(encoding="utf-8")


def promises() -> dict[int, str]:
    """The promise of each fault."""
    found = re.findall(r"^\| (\d\d) \| .+? \| (.+?) \|$", PAGE, re.MULTILINE)
    assert len(found) == len(dict(found)), "a number is in the tables twice"
    return {int(number): promise for number, promise in found}


def named_tests() -> dict[int, str]:
    """The tests of each fault, as text."""
    found = re.findall(r"^- (\d\d):(.*(?:\n  .+)*)", TESTS, re.MULTILINE)
    return {int(number): named for number, named in found}


@cache
def names_in(file: str) -> frozenset[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def test_every_fault_is_there_once() -> None:
    assert sorted(promises()) == list(named_tests())


@pytest.mark.parametrize("number", promises())
def test_the_named_tests_exist(number: int) -> None:
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", named_tests()[number])
    assert named, "a fault without a test is a promise without proof"
    for file, test in named:
        where = file if "/" in file else f"tests/faults/{file}"
        assert test in names_in(where), f"{promises()[number]}: there is no {test} in {where}"


def test_every_test_of_a_fault_names_it() -> None:
    for path in sorted((ROOT / "tests" / "faults").glob("test_*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                said = re.match(r"Rows? (\d\d)", ast.get_docstring(node) or "")
                if path.name != "test_damaged_datasets.py":  # of one idea, named by its file
                    assert said, f"{path.name}::{node.name} does not say its row"
                    assert int(said[1]) in promises()
