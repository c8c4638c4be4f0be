"""The sections that compare rows over several datasets: over all of them, and over the core."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from swarmdata.evaluation.results.aggregates import (
    comparable_scores,
    differences,
    mean_over_datasets,
)
from swarmdata.evaluation.results.result_plots import plot_differences, plot_score_profiles
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import aggregate_table
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.safety import MAX_ALGORITHMS_IN_MATRIX
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard, plot_beside_data
from swarmdata.rollouts.score_statistics import Estimate


def aggregate_sections(found: Findings, out: Path) -> dict[str, str]:
    """The sections by title; none of fewer than two rows or datasets."""
    sections, results, core = {}, found.results, _core(found)
    if body := _aggregates(results, out / "differences.png"):
        plot_score_profiles(comparable_scores(results).tables, found.looks, out / "profiles.png")
        body += "\n![share of runs above a score](profiles.png)\n"
        sections["Aggregates over datasets"] = body
    if body := _aggregates(core, out / "core-differences.png"):
        on_all = comparable_scores(core).tables
        families = {label: family for label, family in found.families.items() if label in on_all}
        plot_beside_data(make_scoreboard(core, families, "score"), out / "core.png")
        title = f"The core: {len(on_all)} rows on {len(core.cases)} datasets"
        sections[title] = f"![score by dataset](core.png)\n\n{body}"
    return sections


def core_rows(found: Findings) -> list[dict[str, object]]:
    """The mean score over the core of each row that is on all of it, alone and minus each other."""
    tables = comparable_scores(_core(found)).tables

    def measured() -> Iterator[tuple[str, str, Estimate]]:
        for label, table in tables.items():
            yield label, "", mean_over_datasets(table)
        for (label, other), each in differences(tables).items():
            yield label, other, each

    return [
        {"label": label, "minus": other, "mean": each.value, "low": each.low, "high": each.high}
        for label, other, each in measured()
    ]


def _core(found: Findings) -> ResultSet:
    """The results on the core alone."""
    ids = {found.dataset_ids.get(short_name(name)) for name in found.study.core}
    cases = tuple(case for case in found.results.cases if case.name in ids)
    return replace(found.results, cases=cases)


def _aggregates(results: ResultSet, figure: Path) -> str:
    """Aggregates of the rows that are on all datasets, whose differences are drawn to a file.

    Empty if there are fewer than two rows or datasets.
    """
    tables = comparable_scores(results).tables
    if len(tables) < 2 or len(results.cases) < 2:
        return ""
    body = aggregate_table(results).to_markdown()
    if 2 < len(tables) <= MAX_ALGORITHMS_IN_MATRIX:  # of two, the table has the one difference
        plot_differences(tables, figure)
        body += f"\n![paired differences of scores]({figure.name})\n"
    return body
