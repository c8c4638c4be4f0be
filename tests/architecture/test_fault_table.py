"""The table of faults in CONTRIBUTING names every case, and only tests that exist."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
N_CASES = 70


def rows() -> list[tuple[int, str, str, str]]:
    """Number, case, promise, tests."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.split("\n## Faults\n")[1].split("\n## ")[0]
    found = re.findall(r"^\| (\d\d) \| (.+?) \| (.+?) \| (.+?) \|$", section, re.MULTILINE)
    return [(int(number), case, promise, tests) for number, case, promise, tests in found]


@cache
def names_in(file: str) -> frozenset[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def test_every_case_is_there_once() -> None:
    assert [number for number, *_ in rows()] == list(range(1, N_CASES + 1))


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row[0]:02d}")
def test_the_named_tests_exist(row: tuple[int, str, str, str]) -> None:
    _, _, promise, tests = row
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", tests)
    assert named, "a case without a test is a promise without proof"
    for file, test in named:
        where = file if "/" in file else f"tests/faults/{file}"
        assert test in names_in(where), f"{promise}: there is no {test} in {where}"


def test_every_test_of_a_fault_names_a_case() -> None:
    for path in sorted((ROOT / "tests" / "faults").glob("test_*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                said = re.match(r"Rows? (\d\d)", ast.get_docstring(node) or "")
                if path.name != "test_damaged_datasets.py":  # of one idea, named by its file
                    assert said, f"{path.name}::{node.name} does not say its row"
                    assert 1 <= int(said[1]) <= N_CASES
