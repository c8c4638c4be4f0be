"""Numbers of pages that name their cell in a results file: `81.5 ± 1.4<!--regimes:iql:...-->`.

A mark is `STUDY:KEYS` or `STUDY/TABLE:KEYS`: the values that pick one row of
`cards/studies/STUDY/TABLE.csv` (`estimates.csv` without a table). Keys of a table are in `KEYS`.
"""

import csv
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

MARK = re.compile(r"([+−-]?\d[\d.]*)(?: ± (\d[\d.]*))?\**<!--(\S+?)-->")
"""A number, half of its interval if that is shown, and the cell."""

KEYS = {
    "estimates": ("label", "dataset", "quantity"),
    "core": ("label", "minus"),
    "differences": ("one", "other", "dataset", "quantity"),
    "views": ("dataset", "view", "label", "quantity"),
    "tasks": ("dataset", "policy", "used_with", "metric"),
    "transfer": ("dataset", "policy", "trained_with", "used_with", "metric"),
    "sweep": ("policy", "value", "metric"),
    "simulators": ("task", "team", "quantity", "backend"),
}
"""Table -> columns whose values a mark has, in this order; of `data`, dataset and column."""

RATES = ("success", "clean_success")
"""Quantities that pages show in percent."""

HIDDEN = re.compile(r"```.*?```|^ {4}[^\n]*|`[^`]*`|\]\([^)]*\)|<[^>]*>", re.DOTALL | re.MULTILINE)
"""Code, addresses of links, and tags: they have no results."""


def readme_scores(readme: str) -> Iterator[tuple[str, str, str]]:
    """The label, dataset and text of each cell of the README's table of scores."""
    head, _, *rows = readme[readme.index("| score on") :].partition("\n\n")[0].splitlines()
    tiers = head.strip("| ").split(" | ")[1:]
    for row in rows:
        label, *cells = row.strip("| ").split(" | ")
        for tier, text in zip(tiers, cells, strict=True):
            yield label.strip("`"), f"coop_nav-{tier}", text


def _key(value: str) -> str:
    """How a mark writes a value: without version and spaces."""
    return value.removesuffix("-v1").replace(" ", "_")


@cache
def _rows(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as text:
        return list(csv.DictReader(text))


def cell(mark: str, studies: Path) -> tuple[float, float]:
    """The value of a cell and half of its interval, in shown units.

    Raises:
        LookupError: no row, or several, have these keys.
    """
    place, *keys = mark.split(":")
    study, _, table = place.partition("/")
    table = table or "estimates"
    name, file = table.rpartition("/")[2], studies / study / f"{table}.csv"
    columns = KEYS.get(name, ("dataset",))
    found = {
        tuple(row.get(column, "") for column in ("estimate", "mean", "low", "high", keys[-1]))
        for row in _rows(file)
        if all(_key(row[column]) == key for column, key in zip(columns, keys, strict=False))
    }
    if len(found) != 1:
        raise LookupError(f"{mark} names {len(found)} cells of {file}, expected one")
    estimate, mean, low, high, column = found.pop()
    factor = 100.0 if {*keys} & {*RATES} else 1.0
    value = factor * float(estimate or mean or column)
    return value, factor * (float(high) - float(low)) / 2 if low else 0.0


def _shown(value: float, like: str) -> str:
    decimals = len(like.partition(".")[2])
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def faults(text: str, studies: Path) -> Iterator[str]:
    """What is wrong with the numbers of a page: a mark without a cell, a wrong or unmarked number.

    Every number with a decimal point has to have a mark.
    """
    if text.count("<!--") != len(list(MARK.finditer(text))):
        yield "a mark follows no number"
    for shown, half, mark in MARK.findall(text):
        try:
            value, width = cell(mark, studies)
        except (LookupError, OSError) as error:
            yield str(error)
            continue
        number = shown.replace("−", "-").removeprefix("+")
        if number != _shown(value, number):
            yield f"{mark}: the page has {number}, the file {_shown(value, number)}"
        if half and half != _shown(width, half):
            yield f"{mark}: the page has ± {half}, the file ± {_shown(width, half)}"
    for number in re.findall(r"\d+\.\d+", HIDDEN.sub("", MARK.sub("", text))):
        yield f"{number} has no mark"
