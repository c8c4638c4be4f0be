"""Kernels copy arrays by loops."""

import ast
from collections.abc import Iterator

from tests.support.package_sources import sources


def slice_assignments(tree: ast.Module) -> Iterator[str]:
    """Assignments of anything but a constant to a slice, in kernels."""
    for function in ast.walk(tree):
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


def test_arrays_are_copied_by_loops() -> None:
    """For the error of shapes that differ, numba compiles some thirty functions on strings."""
    found = {
        path: list(slice_assignments(ast.parse(text)))
        for path, text in sources().items()
        if "@kernel" in text
    }

    assert {path: lines for path, lines in found.items() if lines} == {}
