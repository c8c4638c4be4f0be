"""The rows of `make matrix`, and what its commands install."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.version_matrix import NAMES, ROOT, counts, pinned_torch, rows


def test_newest_and_lowest_are_the_ends_of_what_is_supported() -> None:
    made = {row.name: row for row in rows(("python3.13", "python3.11"), "torch==2.13.0")}
    assert tuple(made) == NAMES
    assert made["newest"][1:] == ("python3.13", "test", "newest", "")
    assert made["lowest"][1:] == ("python3.11", "test", "lowest", "torch==2.13.0")


def test_the_outcome_is_that_of_pytest(tmp_path: Path) -> None:
    report = tmp_path / "tests.xml"
    report.write_text(
        '<testsuites><testsuite tests="9" skipped="2" failures="1" errors="3"/></testsuites>'
    )
    assert counts(report) == "3 passed, 2 skipped, 1 failed, 3 errors"


def install_command(**settings: str) -> str:
    """What `make test` would run to install the package in a new environment."""
    given = [f"{name}={value}" for name, value in settings.items()]
    command = ["make", "-n", "test", f"PYTHON={sys.executable}", "VENV=.venv-absent", *given]
    environment = {"PATH": os.environ["PATH"]}  # without the settings of a make that runs this
    said = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    ).stdout
    (line,) = (line for line in said.splitlines() if "--editable" in line)
    return line


@pytest.mark.skipif(shutil.which("make") is None, reason="make is absent")
def test_the_newest_packages_have_no_constraint_and_the_lowest_have_theirs() -> None:
    newest = install_command(PACKAGES="newest")
    assert "--constraint" not in newest
    assert "torch" not in newest
    assert "--constraint constraints.txt" in install_command(PACKAGES="pinned")
    lowest = install_command(PACKAGES="lowest", TORCH=pinned_torch())
    assert "--constraint .venv-absent/lowest.txt" in lowest
    assert "[torch,plots]" in lowest
    assert lowest.endswith(pinned_torch())
