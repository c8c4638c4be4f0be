"""Tests with the newest packages and with the lowest, the commands of the core alone, and the site.

    make matrix

Prints a table with a row for each. Every row makes its virtual environment anew, so that the newest
packages of the day are in it.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
PYTHONS = ("python3.13", "python3.12", "python3.11")
"""Newest first, as in the classifiers of pyproject.toml."""

NAMES = ("newest", "lowest", "core", "docs")
"""Rows of the table, and of each its virtual environment: `.venv-NAME`."""

SHOWN = ("numpy", "numba", "zarr", "pydantic", "torch")
"""Distributions whose versions the table has."""


class Row(NamedTuple):
    """One environment, and what is made in it."""

    name: str
    python: str
    target: str  # of the Makefile
    packages: str = ""  # as in the Makefile; empty: its default
    torch: str = ""  # requirement; empty: its default

    @property
    def environment(self) -> Path:
        return ROOT / f".venv-{self.name}"


def rows(pythons: tuple[str, ...], torch: str) -> tuple[Row, ...]:
    """The rows of the table.

    Args:
        pythons: that are installed, the newest first.
        torch: requirement of a torch that the oldest Python can install, or empty.
    """
    newest, oldest = pythons[0], pythons[-1]
    return (
        Row("newest", newest, "test", "newest"),
        Row("lowest", oldest, "test", "lowest", torch),
        Row("core", newest, "core"),
        Row("docs", oldest, "docs", torch=torch),
    )


def installed() -> tuple[str, ...]:
    """Those of `PYTHONS` that run here; a name alone may be a shim of a version manager."""
    found = (name for name in PYTHONS if shutil.which(name))
    return tuple(
        name
        for name in found
        if subprocess.run([name, "-c", ""], capture_output=True, check=False).returncode == 0
    )


def pinned_torch() -> str:
    """The line of torch in constraints.txt."""
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    return re.findall(r"^torch==[\w.]+", text, re.MULTILINE)[0]


def run(row: Row) -> tuple[str, ...]:
    """Makes a row and returns its cells."""
    shutil.rmtree(row.environment, ignore_errors=True)
    report = row.environment / "tests.xml"
    arguments = f"--junitxml={report}"
    if row.packages == "lowest":  # old packages use what the newest of theirs deprecate
        arguments += " -W ignore::DeprecationWarning"
    begin = time.monotonic()
    settings = {
        "PYTHON": row.python, "VENV": row.environment.name, "PACKAGES": row.packages,
        "TORCH": row.torch, "ARGS": arguments if row.target == "test" else "",
    }  # fmt: skip
    given = (f"{name}={value}" for name, value in settings.items() if value)
    command = ["make", row.target, *given]
    theirs = {*settings, "MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS"}  # of the make that runs this
    own = {name: value for name, value in os.environ.items() if name not in theirs}
    code = subprocess.run(command, cwd=ROOT, env=own, check=False).returncode
    minutes = f"{(time.monotonic() - begin) / 60:.0f}"
    outcome = counts(report) if report.exists() else "passed" if code == 0 else "failed"
    return row.name, row.python, *versions(row.environment), outcome, minutes, str(code)


def counts(report: Path) -> str:
    """What pytest's report in JUnit's format counts."""
    suite = ElementTree.parse(report).getroot()[0]
    total, *others = (int(suite.get(key, 0)) for key in ("tests", "skipped", "failures", "errors"))
    return "{} passed, {} skipped, {} failed, {} errors".format(total - sum(others), *others)


def versions(environment: Path) -> Iterator[str]:
    """The installed version of each distribution of `SHOWN`, "-" where there is none."""
    script = (
        "from importlib.metadata import distributions as all; "
        f"found = {{each.name.lower(): each.version for each in all()}}; "
        f"print(*(found.get(name, '-') for name in {SHOWN!r}))"
    )
    python = environment / "bin/python"
    if not python.exists():
        return iter(["-"] * len(SHOWN))
    done = subprocess.run([python, "-c", script], capture_output=True, text=True, check=True)
    return iter(done.stdout.split())


def main() -> None:
    """Runs all rows, or the named ones."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--torch", default=pinned_torch(), help="of the oldest Python; '': none")
    parser.add_argument("--only", nargs="+", default=NAMES, choices=NAMES, help="rows")
    arguments = parser.parse_args()
    chosen = [row for row in rows(installed(), arguments.torch) if row.name in arguments.only]
    made = [run(row) for row in chosen]
    head = ("environment", "python", *SHOWN, "outcome", "minutes")
    for cells in (head, ("---",) * len(head), *(cells[:-1] for cells in made)):
        sys.stdout.write(f"| {' | '.join(cells)} |\n")
    sys.exit(any(cells[-1] != "0" for cells in made))


if __name__ == "__main__":
    main()
