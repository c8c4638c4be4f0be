"""Interleaved timing of several runs, and tables of the results."""

import csv
import os
import platform
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.benchmarks.engines import Run

PACKAGES = (
    "numpy", "numba", "pymunk", "vmas", "benchmarl", "torchrl", "torch", "mpe2", "pettingzoo",
)  # fmt: skip

PAGE = Path(__file__).parents[2] / "docs" / "measurements.md"
TABLES = PAGE.with_suffix("")


class Rate(NamedTuple):
    """A rate (or a ratio): median, smallest and largest over the rounds."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: list[float]) -> "Rate":
        return cls(float(np.median(values)), min(values), max(values))

    def __str__(self) -> str:
        """With thousands as k."""
        return f"{short(self.median)} ({short(self.low)}–{short(self.high)})"


def short(rate: float) -> str:
    """Three digits: 95.1, 12.3k, 1.25M."""
    for scale, unit in ((1e6, "M"), (1e3, "k")):
        if rate >= 0.9995 * scale:
            return f"{rate / scale:{'.3g' if rate < 999.5 * scale else '.0f'}}{unit}"
    return f"{rate:.3g}"


def interleave(runs: Mapping[str, Run], rounds: int = 5, seconds: float = 0.4) -> dict[str, Rate]:
    """Measures all runs in turns, so that what slows the machine slows all of them."""
    rates: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run(seconds / 4)  # warms the caches
    for _ in range(rounds):
        for name, run in runs.items():
            rates[name].append(run(seconds))
    return {name: Rate.of(values) for name, values in rates.items()}


def use_last_core() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def pair(ours: Run, other: Run) -> Rate:
    """Our rate over another's, measured in turns: the median of the ratios of neighbours."""
    ratios, seconds = [], 0.2
    for run in (ours, other):
        run(seconds / 4)  # warms the caches
    for turn in range(9):
        first, second = (ours, other) if turn % 2 else (other, ours)
        rates = first(seconds), second(seconds)
        ratios.append(rates[0] / rates[1] if turn % 2 else rates[1] / rates[0])
    return Rate.of(ratios)


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table whose first column is left, the others right aligned."""
    lines = [head, ("---", *("---:" for _ in head[1:])), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


MAX_ROWS, MAX_CELLS = 9, 40
"""Of a table in the page; a larger one is a file beside it."""


def write_section(title: str, body: str) -> None:
    """Puts a section into docs/measurements.md: in its old place, or at the end."""
    body = long_tables_as_files(title, body)
    head, *old = PAGE.read_text(encoding="utf-8").split("\n## ")
    parts = dict(part.split("\n", 1) for part in old)
    parts[title] = f"\n{body.strip()}\n\n*{', '.join([_processor(), *_differences(head)])}*\n"
    sections = (f"## {section}\n{text.rstrip()}\n" for section, text in parts.items())
    PAGE.write_text("\n".join([head, *sections]), encoding="utf-8")


def long_tables_as_files(title: str, body: str) -> str:
    """Writes the large tables of a section as CSV, and returns it with links in their place."""
    names = (f"{re.sub('[^a-z]+', '-', title.lower())}{n}.csv" for n in ("", *range(-2, -9, -1)))

    def replaced(found: re.Match[str]) -> str:
        head, _, *rows = found[0].splitlines()
        if len(rows) <= MAX_ROWS and len(rows) * (head.count("|") - 1) <= MAX_CELLS:
            return found[0]
        name = next(names)
        lines = ([cell.strip() for cell in row.strip("|").split("|")] for row in (head, *rows))
        TABLES.mkdir(exist_ok=True)
        with (TABLES / name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(lines)
        return f"[Table]({TABLES.name}/{name})\n"

    return re.sub(r"(?:^\|.*\n)+", replaced, body, flags=re.MULTILINE)


def _differences(head: str) -> list[str]:
    """Number of cores, and the versions here that are not those in the head of the page."""
    usual = " ".join(head.split())
    found = [f"Python {platform.python_version()}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return [f"{os.cpu_count()} cores", *(each for each in found if each not in usual)]


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    values = {key.strip(): value.strip() for key, value in fields.items()}
    if "model name" not in values:
        return platform.processor() or platform.machine()
    return f"{values['model name']} (model {values.get('model', '?')})"
