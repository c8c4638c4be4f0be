"""No module of ours is imported by a string, which would hide an arrow from the import contracts.

Components are named in literal tables of "module:Name", at the top of a module, and imported by
`runtime.own_components.import_component` where a user names one.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("swarmdata", "envs", "behavior_policies", "offline_algos", "online_algos", "cards")

IMPORTERS = {
    "swarmdata/__init__.py": "the public names, which its type-checking imports name as well",
    "swarmdata/runtime/own_components.py": "components",
    "swarmdata/runtime/engines/jobs.py": "what a worker does",
}
"""Files that may call `import_module` on modules of ours, and what for."""


def sources() -> Iterator[tuple[str, ast.Module]]:
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))


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
    return name in ("import_module", "__import__")


def test_modules_of_ours_are_imported_by_statements() -> None:
    found = {
        file
        for file, tree in sources()
        for node in ast.walk(tree)
        if is_import(node)
        and not any(text and not text.startswith("swarmdata") for text in strings_below(node))
    }
    assert found == set(IMPORTERS)
