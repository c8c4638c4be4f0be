"""Information: what it costs to train and act with worse sensors and radios."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.figures.dot_plot import Panel, PanelLine, plot_dots
from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.conditions.transferred_views import describe_transfers
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.cells.cells import ONLINE_FAMILY
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.information_section import view_columns
from swarmdata.evaluation.study.pages.row_differences import Verdict, format_difference, verdict_of
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate

MEMORY = "memory"
"""What studies call pairs of a row that remembers and the same row without a memory."""


BOLD = "; bold are the best of a view and those that are not clearly worse, paired by episode"


class Views(NamedTuple):
    """What was measured on one dataset of a study."""

    dataset: str  # short name
    board: Scoreboard  # of the score
    cases: Mapping[str, str]  # label of a view, in the plan's order -> its case on the board
    against: Mapping[str, str]  # label of a view -> the measured view that it is compared with

    @property
    def measured(self) -> list[str]:
        """Algorithms that were measured in a view."""
        measured = {label for case in self.cases.values() for label in self.board.estimates[case]}
        return [label for label in self.board.families if label in measured]

    def changes(self, view: str) -> dict[str, Estimate]:
        """View minus the one that it is compared with, by algorithm, paired by episode."""
        values = self.board.values[self.cases[view]]
        base = self.board.values[self.cases[self.against[view]]]
        return {
            label: difference_interval(values[label], base[label])
            for label in values
            if label in base
        }


def answer_information_regimes(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies that train and evaluate in several views of the same data."""
    measured = [(each, views) for each in evidence for views in _views_of(each)]
    if not measured:
        return None
    sentences: list[str] = []
    details, figures = "", []
    headline = " ".join(best_scores(views) for _, views in measured)
    for each, views in measured:
        pairs = each.found.study.differences.get(MEMORY)
        sentences += [view_sentence(views, view) for view in views.against if views.changes(view)]
        sentences += [memory_sentence(views, *pair) for pair in (pairs.pairs if pairs else ())]
        figures.append(f"information-{each.name}-{views.dataset}.png")
        draw_views(views, out / figures[-1])
        bold = "" if len(views.measured) == 1 else BOLD
        details += (
            f"Study {each.name} on {views.dataset}: {views.board.column.label} of policies that "
            f"learned in a view and are used in it{bold}.\n\n{table_of(views)}\n"
            f"![{views.board.column.label} by view]({figures[-1]})\n\n"
        )
        moved = describe_transfers(each, views.dataset, out)
        sentences += moved.sentences
        details += moved.details
        figures += moved.figures
    chosen = tuple(dict.fromkeys(each for each, _ in measured))
    return Answer(headline, tuple(filter(None, sentences)), details, chosen, tuple(figures))


def _views_of(evidence: Evidence) -> Iterator[Views]:
    """Datasets of which two views that are compared were measured."""
    found, plan = evidence.found, evidence.found.study.information
    if plan is None or found.views is None:
        return
    board = make_scoreboard(found.views, found.view_families, quantity_of(found.views).column.key)
    first = next(iter(plan.views))
    for dataset in map(short_name, plan.datasets):
        cases = dict(view_columns(found, dataset))
        references = {view: plan.views[view].against or first for view in cases}
        against = {
            view: reference
            for view, reference in references.items()
            if reference in cases and reference != view
        }
        if against:
            yield Views(dataset, board, cases, against)


def best_scores(views: Views) -> str:
    """The best algorithm's score in the first view, and in the views of the least and the most."""
    column, found = views.board.column, views.board.estimates
    best = {view: found[case][views.board.ranking(case)[0]] for view, case in views.cases.items()}
    first, *others = best
    ranked = sorted(others, key=lambda view: -best[view].value)
    shown = {view: f"{format_estimate(best[view], column)} with `{view}`" for view in best}
    ends = (
        f"{shown[ranked[0]]} to {shown[ranked[-1]]} in {len(ranked)} other views"
        if len(ranked) > 1
        else shown[ranked[0]]
    )
    joint = "and from " if len(ranked) > 1 else "and "
    is_online = ONLINE_FAMILY in map(views.board.families.get, views.measured)
    where = f"{views.dataset} and in its task" if is_online else views.dataset
    return f"On {where}, the best {column.label} is {shown[first]}, {joint}{ends}."


def view_sentence(views: Views, view: str) -> str:
    """What a view costs: how many algorithms, and which of them most and least."""
    changes, column = views.changes(view), views.board.column
    case = views.cases[view]
    best = max(changes, key=lambda label: views.board.estimates[case][label].value)
    ranked = sorted(changes, key=lambda label: -changes[label].value)
    text = f"On {views.dataset}, with `{view}` instead of `{views.against[view]}`, "
    if len(changes) == 1:
        change = changes[best]
        return (
            f"{text}the {column.label} of `{best}` changes by {format_difference(change, column)} "
            f"({verdict_of(change)})."
        )
    verdicts = [verdict_of(change) for change in changes.values()]
    return (
        f"{text}the {column.label} of {_counted(verdicts, 'lower')} of {len(changes)} algorithms "
        f"falls clearly and that of {_counted(verdicts, 'higher')} rises; from "
        f"{_changed(ranked[-1], changes, views)} to {_changed(ranked[0], changes, views)}. The "
        f"best is `{best}` with {format_estimate(views.board.estimates[case][best], column)}."
    )


def _counted(verdicts: Sequence[Verdict], kind: Verdict) -> str:
    return str(verdicts.count(kind) or "none")


def _changed(label: str, changes: Mapping[str, Estimate], views: Views) -> str:
    return f"{format_difference(changes[label], views.board.column)} (`{label}`)"


def memory_sentence(views: Views, one: str, other: str) -> str:
    """In which views a row that remembers is better, and in which it is worse."""
    column, groups = views.board.column, dict[Verdict, list[str]]()
    for view, case in views.cases.items():
        values = views.board.values[case]
        if {one, other} <= values.keys():
            lead = views.board.lead(case, one, other)
            shown = f"`{view}` ({format_difference(lead, column)})"
            groups.setdefault(verdict_of(lead), []).append(shown)
    if not groups:
        return ""
    parts = [
        f"{words} {', '.join(groups[verdict])}"
        for verdict, words in (("higher", "better in"), ("lower", "worse in"))
        if verdict in groups
    ]
    if unclear := groups.get("no clear change"):
        parts.append(f"neither clearly in {len(unclear)} of the views")
    return f"On {views.dataset}, `{one}` against `{other}`: {'; '.join(parts)}."


def draw_views(views: Views, path: Path) -> None:
    """Draws a matrix of views and algorithms, or one algorithm's estimates by view."""
    column = views.board.column
    shown = {view: views.board.in_shown_units(case) for view, case in views.cases.items()}
    if len(views.measured) > 1:
        values = {
            view: {label: each.value for label, each in found.items()}
            for view, found in shown.items()
        }
        plot_score_matrix(values, path, label=column.label, decimals=column.decimals)
        return
    (label,) = views.measured
    estimates = {view: found[label] for view, found in shown.items() if label in found}
    panel = Panel(estimates, f"{column.label} of {label}")
    plot_dots([PanelLine(list(estimates), [panel])], {}, path, legend={})


def table_of(views: Views) -> str:
    """A row for each view, a column for each algorithm."""
    labels, rows = list(views.board.families), []
    for view, case in views.cases.items():
        leaders = views.board.leaders(case) if len(views.measured) > 1 else ()
        cells = (_text(views, case, label, label in leaders) for label in labels)
        rows.append((f"`{view}`", *cells))
    return markdown.table(("view", *(f"`{label}`" for label in labels)), rows)


def _text(views: Views, case: str, label: str, is_best: bool) -> str:
    found = views.board.estimates[case].get(label)
    if found is None:
        return UNDEFINED
    text = format_estimate(found, views.board.column)
    return f"**{text}**" if is_best else text
