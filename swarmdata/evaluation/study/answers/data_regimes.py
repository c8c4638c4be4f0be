"""Data regimes: which algorithm is best on which data."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.row_differences import main_column
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard
from swarmdata.evaluation.study.pages.study_figures import plot_scores
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.specs.plain_names import without_version


def answer_data_regimes(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies of several datasets on the reserved seeds."""
    chosen = [
        each for each in evidence if each.is_on_reserved_seeds and len(each.found.results.cases) > 1
    ]
    if not chosen:
        return None
    sentences, parts, figures = [], [], []
    for each in chosen:
        found = each.found
        board = make_scoreboard(found.results, found.families, main_column(found).key)
        sentences += study_text.families(board) + study_text.winners(board)
        shown = {without_version(name): board.in_shown_units(name) for name in board.estimates}
        data = {
            without_version(name): board.column.factor * mean for name, mean in board.data.items()
        }
        figure = f"data-regimes-{each.name}.png"
        plot_scores(
            shown, data, found.families, found.looks, out / figure, label=board.column.label
        )
        figures.append(figure)
        parts.append(
            f"![{board.column.label} by dataset]({figure})\n\n{board.column.label.capitalize()} in "
            f"study {each.name}; bold are the best and those that are not clearly worse, paired by "
            f"episode:\n\n{scoreboard_table(board)}"
        )
    return Answer(tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))
