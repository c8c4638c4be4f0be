"""Compiled functions are kernels: nothing of the package uses numba's own decorators."""

import ast
import re
from collections.abc import Iterator

import pytest

from swarmdata.runtime.kernels import PACKAGE_FOLDER

FILES = sorted(PACKAGE_FOLDER.glob("**/*.py")) + sorted(
    file
    for folder in PACKAGE_FOLDER.iterdir()
    if folder.is_symlink()
    for file in folder.rglob("*.py")
)
OWN_DECORATOR = re.compile(r"@(?:numba\.)?n?jit\b|import .*\bn?jit\b")


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """The text of every module."""
    return {str(file.relative_to(PACKAGE_FOLDER)): file.read_text("utf-8") for file in FILES}


def test_no_other_decorator(sources: dict[str, str]) -> None:
    assert [name for name, source in sources.items() if OWN_DECORATOR.search(source)] == []


def slice_assignments(source: str) -> Iterator[str]:
    """Assignments of anything but a constant to a slice, in kernels."""
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        if not any("kernel" in ast.unparse(each) for each in function.decorator_list):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.Assign) and "[" in ast.unparse(node.value):
                targets = [each for each in node.targets if isinstance(each, ast.Subscript)]
                if any(isinstance(part, ast.Slice) for each in targets for part in parts(each)):
                    yield ast.unparse(node)


def parts(target: ast.Subscript) -> list[ast.expr]:
    index = target.slice
    return list(index.elts) if isinstance(index, ast.Tuple) else [index]


def test_arrays_are_copied_by_loops(sources: dict[str, str]) -> None:
    """For the error of shapes that differ, numba compiles some thirty functions on strings."""
    found = {name: list(slice_assignments(source)) for name, source in sources.items()}

    assert {name: lines for name, lines in found.items() if lines} == {}


def test_a_slice_assignment_is_seen() -> None:
    source = "@kernel\ndef f(a, b):\n    a[:] = 0.0\n    a[1:, 0] = b[2:]\n    a[0] = b[1]\n"
    assert list(slice_assignments(source)) == ["a[1:, 0] = b[2:]"]
