"""Sizes of modules and functions, and a docstring on every public name."""

import ast
from collections.abc import Iterator

from tests.support.package_sources import sources, trees

MODULE_LINES = 500
FUNCTION_LINES = 40
KERNEL_LINES = 60  # so that nobody splits one thought to please a counter

Function = ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(function: Function) -> int:
    """Lines of a function from `def` to its end, its docstring left out.

    Of a command only its body counts: its parameters are options, one a line.
    """
    first = function.body[0]
    begin = first.lineno if is_command(function) else function.lineno
    length = (function.end_lineno or function.lineno) - begin + 1
    if ast.get_docstring(function, clean=False) is None:
        return length
    return length - ((first.end_lineno or first.lineno) - first.lineno + 1)


def functions(body: list[ast.stmt]) -> Iterator[Function]:
    """Those in statements, at any depth; expressions, most of a tree, hold none."""
    for node in body:
        if isinstance(node, Function):
            yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from functions(getattr(node, name, []))


def is_command(function: Function) -> bool:
    annotations = [each.annotation for each in function.args.args[:1]]
    return any(isinstance(each, ast.Attribute) and each.attr == "Context" for each in annotations)


def most_lines(function: Function) -> int:
    """How many lines a function may have; compiled kernels more."""
    decorators = [
        node.func if isinstance(node, ast.Call) else node for node in function.decorator_list
    ]
    is_kernel = any(isinstance(node, ast.Name) and node.id == "kernel" for node in decorators)
    return KERNEL_LINES if is_kernel else FUNCTION_LINES


def undocumented(tree: ast.Module) -> Iterator[str]:
    """Public functions and classes of a module, and the module, that have no docstring."""
    if ast.get_docstring(tree) is None:
        yield "the module"
    for node in tree.body:
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        if not node.name.startswith("_") and not is_overload(node) and not ast.get_docstring(node):
            yield node.name


def is_overload(node: ast.AST) -> bool:
    """Whether this is one signature of several, which the function itself documents."""
    names = getattr(node, "decorator_list", [])
    return any(isinstance(name, ast.Name) and name.id == "overload" for name in names)


def test_modules_are_short() -> None:
    lengths = {path: len(text.splitlines()) for path, text in sources().items()}

    assert {path: length for path, length in lengths.items() if length > MODULE_LINES} == {}


def test_functions_are_short() -> None:
    too_long = {
        f"{path}:{node.name}": length
        for path, tree in trees().items()
        for node in functions(tree.body)
        if (length := code_lines(node)) > most_lines(node)
    }

    assert too_long == {}


def test_public_names_are_documented() -> None:
    found = {path: list(undocumented(tree)) for path, tree in trees().items()}

    assert {path: names for path, names in found.items() if names} == {}
