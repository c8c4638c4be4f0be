"""Imports only point down, and heavy libraries stay in their rooms."""

from tests.support.interpreter import python
from tests.support.package_sources import ROOT


def test_import_contracts_hold() -> None:
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    result = python("-c", code, cwd=ROOT, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
