"""The table of docs/simulators.md is that of the measured references."""

import re
from pathlib import Path

import pytest

from swarmdata.registry.published import Interval, references

PAGE = (Path(__file__).parents[2] / "docs/simulators.md").read_text("utf-8")
PRESETS = {"unicycles, Pymunk": "coop_nav-unicycle", "on wheels, MuJoCo": "coop_nav-wheeled"}
ROWS = re.findall(r"^\| (scripted|straight) \| ([^|]+) \| (.+) \|$", PAGE, re.MULTILINE)


def shown(found: Interval | None, factor: float, decimals: int, *, has_interval: bool) -> str:
    assert found is not None
    value, low, high = (
        f"{factor * each:.{decimals}f}".replace("-", "−")
        for each in (found.value, found.low, found.high)
    )
    return f"{value} [{low}, {high}]" if has_interval else value


@pytest.mark.parametrize(("policy", "robots", "cells"), ROWS)
def test_a_row_has_what_was_measured(policy: str, robots: str, cells: str) -> None:
    found = references()[PRESETS[robots]].policies[policy]
    others = ("robot_collisions", "obstacle_collisions", "time_to_goal")
    assert cells.split(" | ") == [
        shown(found["success"], 100, 1, has_interval=True),
        shown(found["return"], 1, 2, has_interval=True),
        *(shown(found[name], 1, 2, has_interval=False) for name in others),
    ]


def test_there_are_four_rows() -> None:
    assert len(ROWS) == 4
