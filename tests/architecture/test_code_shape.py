"""Sizes of modules and functions, and a docstring on every public name."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("swarmdata", "envs", "behavior_policies", "offline_algos", "online_algos", "cards")
SOURCES = sorted(
    path
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*.py")
    if not any(parent.is_symlink() for parent in path.parents)
)
MODULE_LINES = 500
FUNCTION_LINES = 40
KERNEL_LINES = 60  # so that nobody splits one thought to please a counter

Function = ast.FunctionDef | ast.AsyncFunctionDef


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """The text of every module."""
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in SOURCES}


def code_lines(function: Function) -> int:
    """Lines of a function from `def` to its end, its docstring left out.

    Of a command only its body counts: its parameters are options, one a line.
    """
    first = function.body[0]
    begin = first.lineno if is_command(function) else function.lineno
    length = (function.end_lineno or function.lineno) - begin + 1
    if ast.get_docstring(function) is None:
        return length
    return length - ((first.end_lineno or first.lineno) - first.lineno + 1)


def is_command(function: Function) -> bool:
    """Whether this is a command of the command line."""
    annotations = [each.annotation for each in function.args.args[:1]]
    return any(each is not None and ast.unparse(each) == "typer.Context" for each in annotations)


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


def test_sources_were_found() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in SOURCES} == set(FOLDERS)


def test_modules_are_short(sources: dict[str, str]) -> None:
    lengths = {name: len(source.splitlines()) for name, source in sources.items()}

    assert {name: length for name, length in lengths.items() if length > MODULE_LINES} == {}


def test_functions_are_short(sources: dict[str, str]) -> None:
    too_long = {}
    for name, source in sources.items():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, Function) and code_lines(node) > most_lines(node):
                too_long[f"{name}:{node.name}"] = code_lines(node)

    assert too_long == {}


def test_public_names_are_documented(sources: dict[str, str]) -> None:
    found = {name: list(undocumented(ast.parse(source))) for name, source in sources.items()}

    assert {name: names for name, names in found.items() if names} == {}
