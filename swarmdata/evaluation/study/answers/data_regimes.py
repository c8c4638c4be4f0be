"""Data regimes: which algorithm is best on which data."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.figures.dot_plot import plot_by_dataset
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import main_column
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.specs.plain_names import without_version

ABLATIONS = "ablations"
"""What studies call the family of rows without the ingredient that they are named after."""


def answer_data_regimes(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies of several datasets on the reserved seeds."""
    chosen = [each for each in evidence if each.compares_rows and len(each.found.results.cases) > 1]
    if not chosen:
        return None
    compared = [_without_ablations(each.found) for each in chosen]
    parts, figures = [], []
    for each, drawn in zip(chosen, compared, strict=True):
        found = each.found
        board = make_scoreboard(found.results, found.families, main_column(found).key)
        shown = {without_version(name): drawn.in_shown_units(name) for name in drawn.estimates}
        data = {
            without_version(name): board.column.factor * mean for name, mean in board.data.items()
        }
        figure = f"data-regimes-{each.name}.png"
        plot_by_dataset(
            shown,
            data,
            found.looks,
            out / figure,
            label=board.column.label,
            families=drawn.families,
            shares_axis=board.column.key == "score",
        )
        figures.append(figure)
        parts.append(
            f"![{board.column.label} by dataset]({figure})\n\n{board.column.label.capitalize()} in "
            f"study {each.name}; bold are the best and those that are not clearly worse, paired by "
            f"episode:\n\n{scoreboard_table(board)}"
        )
    winners = study_text.winners(compared[0])  # of the study with the most cells
    headline = study_text.best_families(compared[0]) or winners[0]
    sentences = (*study_text.families(compared[0]), *winners)
    return Answer(headline, sentences, "\n".join(parts), tuple(chosen), tuple(figures))


def _without_ablations(found: Findings) -> Scoreboard:
    """The scores of the rows that are no ablations, which are of no family."""
    families = {label: family for label, family in found.families.items() if family != ABLATIONS}
    return make_scoreboard(found.results, families, main_column(found).key)
