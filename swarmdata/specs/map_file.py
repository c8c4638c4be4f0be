"""Spec files with a map: `map: FILE` beside fields of a spec, in MovingAI's format.

Sturtevant, "Benchmarks for grid-based pathfinding", IEEE Transactions on Computational Intelligence
and AI in Games 2012: a head of four lines (`type`, `height`, `width`, `map`), then a line of
characters for each row. `.` and `G` are ground, `S` is a swamp that can be crossed; `@`, `O`, `T`
and `W` are walls here.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmdata.errors import SpecError
from swarmdata.runtime.documents import MAX_JSON_BYTES
from swarmdata.runtime.regular_files import read_regular

FREE, WALLS = ".GS", "@OTW"

_OTHER = re.compile(f"[^{FREE}{WALLS}]")

CELL = 0.7  # m, side of a cell, unless the spec says another

STEPS_PER_METER = 20.0
"""Control steps of an episode for each metre of width and height, unless the spec says how many."""


def read_map(path: Path) -> tuple[str, ...]:
    """Returns the rows of a map, the first at the top, of `.` (free) and `@` (wall).

    Raises:
        OSError: the file cannot be read.
        SpecError: it is no such map.
    """
    lines = read_regular(path, MAX_JSON_BYTES).decode("ascii", errors="replace").split("\n")
    lines = [line.rstrip("\r") for line in lines]
    while lines and not lines[-1]:
        lines.pop()
    head = [line.split() for line in lines[:4]]
    try:
        (_, _), (_, height), (_, width), (last,) = head
        is_map = [line[0] for line in head] == ["type", "height", "width", "map"] and last == "map"
        size = int(height), int(width)
    except ValueError:
        is_map = False
    if not is_map:
        raise SpecError(
            f"{path} is no map: expected the lines 'type octile', 'height H', 'width W' and 'map' "
            f"at its start, got {lines[:4]}"
        )
    rows = lines[4:]
    wrong = next((k for k, row in enumerate(rows) if len(row) != size[1]), None)
    if wrong is not None:
        raise SpecError(
            f"{path}: line {wrong + 5} has {len(rows[wrong])} cells, expected {size[1]}"
        )
    if len(rows) != size[0]:
        raise SpecError(f"{path} has {len(rows)} rows, expected {size[0]}, as its head says")
    for k, row in enumerate(rows):
        if (other := _OTHER.search(row)) is not None:
            raise SpecError(
                f"{path}: line {k + 5}, column {other.start() + 1} is {other[0]!r}, expected one "
                f"of {FREE}{WALLS}"
            )
    return tuple("".join("." if cell in FREE else "@" for cell in row) for row in rows)


def with_map(document: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the spec of a document that has `map: FILE` and may have `cell: METERS`.

    It is one of `coop_nav`, with an arena as large as the map and no other obstacles. The name of
    the map is relative to `folder`.

    Raises:
        SpecError: the map cannot be read or is none, or the document is of another task, or has an
            arrangement, an arena or obstacles.
    """
    spec = dict(document)
    name, cell = spec.pop("map"), spec.pop("cell", CELL)
    rules = {"task": "coop_nav", **(spec.pop("rules", None) or {})}
    taken = [key for key in ("arena", "obstacles") if key in spec]
    if rules["task"] != "coop_nav":
        raise SpecError(f"a spec with a map is of coop_nav, got the task {rules['task']!r:.100}")
    if "arrangement" in rules or taken:
        raise SpecError(
            f"a spec with a map has {' and '.join(taken) or 'an arrangement'}, which the map "
            "decides; leave it out"
        )
    if not isinstance(name, str) or isinstance(cell, bool) or not isinstance(cell, int | float):
        raise SpecError(f"map is {name!r} and cell {cell!r}, expected a file's name and metres")
    try:
        rows = read_map(folder / name)
    except OSError as error:
        raise SpecError(f"the map {folder / name} cannot be read: {error}") from error
    width, height = (round(cell * n, 6) for n in (len(rows[0]), len(rows)))
    arrangement = {"kind": "map", "rows": rows, "cell": cell}
    nothing = dict.fromkeys(("circles", "boxes", "corners", "pockets"), 0)
    shared = {
        "rules": rules | {"arrangement": arrangement},
        "arena": {"width": width, "height": height},
        "obstacles": nothing,
        "horizon": math.ceil(STEPS_PER_METER * (width + height)),
    }
    return shared | spec
