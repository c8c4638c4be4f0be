"""The package's modules, read and parsed once for all tests of its shape."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("swarmdata", "envs", "behavior_policies", "offline_algos", "online_algos", "cards")


@cache
def sources() -> dict[Path, str]:
    """The text of every module, by its path in the repository."""
    return {
        path.relative_to(ROOT): path.read_text(encoding="utf-8")
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not any(parent.is_symlink() for parent in path.parents)
    }


@cache
def trees() -> dict[Path, ast.Module]:
    """The syntax tree of every module; nobody may change it."""
    return {path: ast.parse(text) for path, text in sources().items()}
