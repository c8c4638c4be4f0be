"""Data regimes: which algorithm is best on which data."""

import math
from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.figures.dot_plot import plot_by_dataset
from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import main_column
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.specs.plain_names import without_version

MOST_PANELS = 8
"""Of a page; more datasets are the rows of a matrix."""


def answer_data_regimes(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies of several datasets on the reserved seeds."""
    chosen = [each for each in evidence if each.compares_rows and len(each.found.results.cases) > 1]
    if not chosen:
        return None
    compared = [
        make_scoreboard(each.found.results, each.families, main_column(each.found).key)
        for each in chosen
    ]
    whole = [
        make_scoreboard(each.found.results, each.found.families, main_column(each.found).key)
        for each in chosen
    ]
    parts, figures = [], []
    for each, drawn, board in zip(chosen, compared, whole, strict=True):
        found = each.found
        figures.append(f"data-regimes-{each.name}.png")
        _draw(found, drawn, out / figures[-1])
        label = board.column.label
        parts.append(
            f"![{label} by dataset]({figures[-1]})\n\n{label.capitalize()} in study {each.name}; "
            "bold are the best and those that are not clearly worse, paired by episode:\n\n"
            f"{scoreboard_table(board)}"
        )
    winners = study_text.winners(compared[0])  # of the study with the most cells
    headline = " ".join(
        [
            study_text.best_families(compared[0]) or winners[0],
            *study_text.ablations_ahead(compared[0], whole[0]),
        ]
    )
    sentences = (*study_text.families(compared[0]), *winners)
    return Answer(headline, sentences, "\n".join(parts), tuple(chosen), tuple(figures))


def _draw(found: Findings, board: Scoreboard, path: Path) -> None:
    """Draws a panel for each dataset; of many datasets a matrix, with the data's own mean."""
    shown = {without_version(name): board.in_shown_units(name) for name in board.estimates}
    data = {without_version(name): board.column.factor * mean for name, mean in board.data.items()}
    if len(shown) <= MOST_PANELS:
        plot_by_dataset(
            shown, data, found.looks, path, label=board.column.label, families=board.families,
            shares_axis=board.column.key == "score",
        )  # fmt: skip
        return
    columns = [label for label in board.families if any(label in row for row in shown.values())]
    values = {
        name: {"mean of the data": data.get(name, math.nan)}
        | {label: row[label].value if label in row else math.nan for label in columns}
        for name, row in shown.items()
    }
    plot_score_matrix(values, path, label=board.column.label, decimals=0)
