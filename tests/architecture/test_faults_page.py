"""docs/faults.md names every fault, and docs/fault-tests.md only tests that exist."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import WHOLE_FILE

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/faults.md").read_text(encoding="utf-8")
TESTS = (ROOT / "docs/fault-tests.md").read_text(encoding="utf-8")

SLOW = (57, 63, 69)
"""Faults that only slow tests plant: no inodes, two trainings in a folder, a real web server."""


def promises() -> dict[int, str]:
    found = re.findall(r"^\| (\d\d) \| .+? \| (.+?) \|$", PAGE, re.MULTILINE)
    assert len(found) == len(dict(found)), "a number is in the tables twice"
    return {int(number): promise for number, promise in found}


def named_tests() -> dict[int, str]:
    found = re.findall(r"^- (\d\d):(.*(?:\n  .+)*)", TESTS, re.MULTILINE)
    return {int(number): named for number, named in found}


@cache
def functions_of(file: str) -> dict[str, bool]:
    """The functions of a file, and whether only `make slow` runs them."""
    text = (ROOT / file).read_text(encoding="utf-8")
    is_slow = WHOLE_FILE.search(text) is not None
    return {
        node.name: is_slow or "pytest.mark.slow" in map(ast.unparse, node.decorator_list)
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef)
    }


def planting(number: int) -> dict[str, bool]:
    """The tests that plant a fault, and whether only `make slow` runs them."""
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", named_tests()[number])
    assert named, "a fault without a test is a promise without proof"
    found = {}
    for file, test in named:
        where = file if "/" in file else f"tests/faults/{file}"
        assert test in functions_of(where), f"{promises()[number]}: there is no {test} in {where}"
        found[f"{where}::{test}"] = functions_of(where)[test]
    return found


def test_every_fault_is_there_once() -> None:
    assert sorted(promises()) == list(named_tests())


@pytest.mark.parametrize("number", promises())
def test_the_named_tests_exist_and_one_is_in_the_default_run(number: int) -> None:
    assert not all(planting(number).values()) or number in SLOW


def test_every_test_of_a_fault_names_it() -> None:
    for path in sorted((ROOT / "tests" / "faults").glob("test_*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                said = re.match(r"Rows? (\d\d)", ast.get_docstring(node) or "")
                if path.name != "test_damaged_datasets.py":  # of one idea, named by its file
                    assert said, f"{path.name}::{node.name} does not say its row"
                    assert int(said[1]) in promises()
