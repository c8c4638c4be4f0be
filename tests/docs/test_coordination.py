"""The numbers of docs/coordination.md are those of the measured references."""

import re
from pathlib import Path

import pytest

from swarmdata.registry.published import Interval, references
from tests.docs.marked_numbers import MARK, faults

PAGE = Path(__file__).parents[2] / "docs" / "coordination.md"

GAPS, LEARNERS = PAGE.read_text("utf-8").split("## Do learners")

ROWS = re.findall(r"^\| `([^`]+)` \|( \d.*)\|$", GAPS, re.MULTILINE)


def percent(value: Interval | None) -> str:
    assert value is not None
    return f"{100 * value.value:.1f}".replace("-0.0", "0.0")


@pytest.mark.parametrize(("preset", "cells"), ROWS)
def test_a_row_has_what_was_measured(preset: str, cells: str) -> None:
    known = references()[preset]
    gaps = [known.gaps.get(f"scripted-{name}") for name in ("alone", "naive", "deaf")]
    expected = [
        percent(known.policies["scripted"]["success"]),
        *("" if gap is None else percent(gap["success"]) for gap in gaps),
        percent(known.gaps["scripted-alone"]["clean_success"]),
    ]
    assert [cell.strip() for cell in cells.split("|")] == expected


def test_scores_of_learners_are_those_of_the_study() -> None:
    assert len(MARK.findall(LEARNERS)) == 99
    assert not list(faults(LEARNERS, PAGE.parents[1] / "cards/studies"))


def test_the_best_naive_team_of_pursuit() -> None:
    teams = [name for name in references()["pursuit"].policies if name.startswith("pursuit-")]
    shares = {name: references()["pursuit"].policies[name]["success"] for name in teams}
    best = max(shares, key=lambda name: float(percent(shares[name])))
    assert best == "pursuit-lead-3"
    text = PAGE.read_text("utf-8").replace("\n  ", " ")
    assert f"solves {percent(shares[best])} %" in text
    naive = references()["pursuit"].gaps["scripted-naive"]["clean_success"]
    assert f"cleanly: {percent(naive)} points" in text


def test_what_robots_that_ignore_each_other_solve_in_coop_nav() -> None:
    alone = references()["coop_nav"].policies["scripted-alone"]
    text = " ".join(PAGE.read_text("utf-8").split())
    assert f"{percent(alone['success'])} % of the episodes are solved" in text
    assert f"{percent(alone['clean_success'])} % cleanly" in text
