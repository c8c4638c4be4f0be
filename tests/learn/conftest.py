"""Without torch, only the tests of what needs none are collected."""

from importlib.util import find_spec
from pathlib import Path

NEED_NO_TORCH = ("test_overrides.py", "test_run_files.py", "test_search_space.py")


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    needs_torch = collection_path.suffix == ".py" and collection_path.name not in NEED_NO_TORCH
    return True if needs_torch and find_spec("torch") is None else None
