"""Pairs of rows: how a figure groups them, and what they say together."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.answers import compared_rows
from swarmdata.evaluation.study.answers.compared_rows import (
    Compared,
    counted_verdicts,
    plot_compared,
)
from swarmdata.evaluation.study.pages.row_differences import RowDifference
from swarmdata.rollouts.score_statistics import Estimate

SCORE = Column("score", "score", "", 1)


def compared(*found: tuple[str, str, float, float]) -> Compared:
    """Pairs of a row and the same without its ingredient: row, dataset, low, high."""
    differences = [
        RowDifference(one, f"{one}-without", dataset, {"score": Estimate(low, low, high)})
        for one, dataset, low, high in found
    ]
    study: Any = SimpleNamespace(name="study")
    return Compared(study, differences, (SCORE,), [])


def test_a_pair_on_several_datasets_is_a_group_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(
        compared_rows, "plot_differences_from_zero", lambda groups, *_: drawn.append(groups)
    )
    found = compared(("a", "x", 1, 2), ("a", "y", 1, 2), ("b", "x", 1, 2), ("c", "x", 1, 2))
    plot_compared([found], tmp_path / "a.png")
    (groups,) = drawn
    assert {title: list(rows) for title, rows in groups.items()} == {
        "a − a-without": ["x", "y"],
        "x": ["b − b-without", "c − c-without"],
    }


def test_verdicts_are_counted_over_studies() -> None:
    found = [
        compared(("a", "x", 1, 2), ("b", "x", -1, 2)),
        compared(("a", "y", -2, -1), ("c", "x", 3, 4)),
    ]
    assert counted_verdicts(found, "it") == (
        "In 4 comparisons, it clearly raises the score in 2, lowers it in 1, and changes nothing "
        "clearly in 1."
    )
