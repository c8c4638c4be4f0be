"""Compiled functions are kernels: nothing of the package uses numba's own decorators."""

import re
from pathlib import Path

import pytest

from swarmdata.runtime.kernels import PACKAGE_FOLDER

FILES = sorted(PACKAGE_FOLDER.glob("**/*.py")) + sorted(
    file
    for folder in PACKAGE_FOLDER.iterdir()
    if folder.is_symlink()
    for file in folder.rglob("*.py")
)
OWN_DECORATOR = re.compile(r"@(?:numba\.)?n?jit\b|import .*\bn?jit\b")


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE_FOLDER)))
def test_no_other_decorator(file: Path) -> None:
    assert not OWN_DECORATOR.search(file.read_text(encoding="utf-8"))
