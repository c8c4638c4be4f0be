"""What only one place may do: compile, read YAML, and import modules of ours by a string.

Such an import would hide an arrow from the import contracts. Components are named in literal tables
of "module:Name", at the top of a module, and imported by `runtime.own_components.import_component`
where a user names one.
"""

import ast
import re
from collections.abc import Iterator

import pytest

from tests.support.package_sources import sources

CALLS = ("import_module", "__import__")

IMPORTERS = {
    "swarmdata/__init__.py": "the public names, which its type-checking imports name as well",
    "swarmdata/runtime/own_components.py": "components",
}
"""Files that may call `import_module` on modules of ours, and what for."""


def strings_below(node: ast.AST) -> Iterator[str]:
    for each in ast.walk(node):
        if isinstance(each, ast.Constant) and isinstance(each.value, str):
            yield each.value


def is_import(node: ast.AST) -> bool:
    name = (
        getattr(node.func, "id", getattr(node.func, "attr", ""))
        if isinstance(node, ast.Call)
        else ""
    )
    return name in CALLS


def test_modules_of_ours_are_imported_by_statements() -> None:
    found = {
        str(path)
        for path, text in sources().items()
        if any(call in text for call in CALLS)
        for node in ast.walk(ast.parse(text))
        if is_import(node)
        and not any(text and not text.startswith("swarmdata") for text in strings_below(node))
    }
    assert found == set(IMPORTERS)


@pytest.mark.parametrize(
    ("calls", "only"),
    [
        (r"@(?:numba\.)?n?jit\b|import .*\bn?jit\b", []),  # compiled functions are kernels
        (
            r"yaml\.(safe_|full_|unsafe_)?(load|parse|compose)(_all)?\(|yaml\.\w*Loader",
            ["swarmdata/runtime/yaml_documents.py"],  # which has bounds
        ),
    ],
)
def test_only_one_module_does_it(calls: str, only: list[str]) -> None:
    found = [path.as_posix() for path, text in sources().items() if re.search(calls, text)]
    assert found == only
