"""Learning in the task: algorithms that collect their own data, beside those that learn offline."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.drawing.style import family_looks
from swarmdata.evaluation.figures.dot_plot import Panel, PanelLine, family_legend, plot_dots
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate
from swarmdata.evaluation.results.learning_curves import Curve, last_gain
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.cells.cells import ONLINE_FAMILY
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.pages.study_figures import plot_training_curves
from swarmdata.specs.plain_names import without_version

BESIDE = ("success", "clean_success", "robot_collisions", "obstacle_collisions")
"""Of the tables, after the score."""

DRAWN = 3
"""Quantities of the figure, the first of the tables."""

HARDLY_ANY = 0.01
"""Below this share of solved episodes a row is said to solve hardly any."""


def answer_online_algorithms(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies that have online rows beside the offline ones.

    Those that train them with several sensors and radios answer what information costs.
    """
    sentences, headlines, parts, figures, chosen = [], [], [], [], []
    for each in evidence:
        plan = each.found.study.information
        results = _with_online_rows(each.found.results)
        if not results.cases or (plan is not None and plan.online):
            continue
        families = _families(each, results)
        keys = (quantity_of(results).column.key, *BESIDE)
        boards = [make_scoreboard(results, families, key) for key in keys]
        figure = f"online-{each.name}.png"
        _draw(boards[:DRAWN], out / figure)
        chosen.append(each)
        figures.append(figure)
        parts.append(f"![{boards[0].column.label} by task]({figure})\n")
        for case in results.cases:
            headlines += list(_headline(case, boards[0]))
            sentences += list(_sentences(case, boards[0], boards[1]))
            parts.append(_table(case, boards))
        curves = _curves(each)
        if curves:
            figures.append(f"online-{each.name}-curves.png")
            drawn = {task: _by_algorithm(each, found) for task, found in curves.items()}
            plot_training_curves(
                drawn,
                family_looks({name: name for found in drawn.values() for name in found}),
                out / figures[-1],
                ylabel="success (%)",
                factor=100.0,
                n_columns=2,
                xlabel="joint steps",
            )
            parts.append(_curve_text(curves, figures[-1]))
    if not parts:
        return None
    headline = " ".join(headlines)
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def _with_online_rows(results: ResultSet) -> ResultSet:
    """The datasets in whose world an algorithm learned online, with its runs beside the others."""
    cases = [(case, results.with_baselines(case)) for case in results.cases]
    return replace(
        results, cases=tuple(both for case, both in cases if len(both.runs) > len(case.runs))
    )


def _families(evidence: Evidence, results: ResultSet) -> dict[str, str]:
    """The family of each row, online ones first."""
    offline = evidence.found.families
    labels = dict.fromkeys(label for case in results.cases for label in case.runs)
    return {label: ONLINE_FAMILY for label in labels if label not in offline} | offline


def _best(board: Scoreboard, case: Case, *, online: bool) -> str | None:
    """The best row of a task that learned online, or offline."""
    ranked = board.ranking(case.name)
    return next((k for k in ranked if (board.families[k] == ONLINE_FAMILY) is online), None)


def _headline(case: Case, board: Scoreboard) -> Iterator[str]:
    """The best of both kinds and their difference, in short."""
    own, other = (_best(board, case, online=kind) for kind in (True, False))
    if own is None:
        return
    found = board.estimates[case.name]
    column = board.column
    text = (
        f"On {case.spec.task}, the {column.label} of `{own}`, which learns in the task, is "
        f"{format_estimate(found[own], column)}"
    )
    if other is not None:
        text += (
            f", that of `{other}` from {without_version(case.name)} "
            f"{format_estimate(found[other], column)}"
        )
    yield f"{text}."


def _sentences(case: Case, board: Scoreboard, success: Scoreboard) -> Iterator[str]:
    """The best of both kinds, and online rows that learned next to nothing."""
    own, other = (_best(board, case, online=kind) for kind in (True, False))
    if own is None:
        return
    name, column, found = without_version(case.name), board.column, board.estimates[case.name]
    task = case.spec.task
    text = (
        f"On {task}, of the algorithms that learn in the task, `{own}` has the highest "
        f"{column.label}: {format_estimate(found[own], column)} after {_length(case, own)}"
    )
    if other is not None:
        text += (
            f"; of those that learned from {name} it is `{other}` with "
            f"{format_estimate(found[other], column)}, a difference of "
            f"{format_difference(board.lead(case.name, own, other), column)}, paired by episode"
        )
    yield f"{text}."
    solved = success.estimates[case.name]
    failed = [
        f"`{label}`"
        for label, family in board.families.items()
        if family == ONLINE_FAMILY and label in solved and solved[label].value < HARDLY_ANY
    ]
    if failed:
        yield f"On {task}, fewer than 1 % of the episodes are solved by {', '.join(failed)}."


def _curves(evidence: Evidence) -> dict[str, dict[str, Curve]]:
    """Task -> row -> success on validation episodes in the course of its online training."""
    panels: dict[str, dict[str, Curve]] = {}
    for cell in evidence.found.cells:
        curve = evidence.found.learning_curve(cell, "success")
        if cell.kind == "online" and curve is not None:
            panels.setdefault(cell.data, {})[cell.label] = curve
    return panels


def _by_algorithm(evidence: Evidence, curves: Mapping[str, Curve]) -> dict[str, Curve]:
    """The curves of a task by algorithm, alike on all tasks; by row where one has several."""
    rows = evidence.found.study.online
    names = {label: rows[label].algorithm or label for label in curves}
    counts = Counter(names.values())
    return {
        names[label] if counts[names[label]] == 1 else label: curve
        for label, curve in curves.items()
    }


def _curve_text(curves: dict[str, dict[str, Curve]], figure: str) -> str:
    """The figure of the curves, and which still rose at the end."""
    gains = {
        label: 100 * last_gain(each) for found in curves.values() for label, each in found.items()
    }
    listed = ", ".join(f"`{label}` {gain:+.1f}" for label, gain in gains.items())
    return (
        f"![success on validation episodes during training]({figure})\n\nSuccess on validation "
        "episodes during the online training: means over seeds, in bands from the lowest to the "
        f"highest seed. Percentage points gained in the last fifth: {listed}.\n"
    )


def _length(case: Case, label: str) -> str:
    return f"{case.runs[label][0].provenance.frames or 0:,} joint steps"


def _table(case: Case, boards: Sequence[Scoreboard]) -> str:
    """A row for each algorithm of a task, the best first."""
    main = boards[0]
    bold = main.leaders(case.name)
    rows = []
    for label in main.ranking(case.name):
        is_online = main.families[label] == ONLINE_FAMILY
        cells = [_text(board, case.name, label) for board in boards]
        cells[0] = f"**{cells[0]}**" if label in bold else cells[0]
        learned = _length(case, label) if is_online else without_version(case.name)
        rows.append((f"`{label}`", str(len(case.runs[label])), learned, *cells))
    headers = (board.column.header for board in boards)
    table = markdown.table(("algorithm", "seeds", "learned from", *headers), rows)
    return f"{case.spec.task}:\n\n{table}"


def _text(board: Scoreboard, dataset: str, label: str) -> str:
    found = board.estimates.get(dataset, {}).get(label)
    return UNDEFINED if found is None else format_estimate(found, board.column)


def _draw(boards: Sequence[Scoreboard], path: Path) -> None:
    """A line of panels for each task, a panel for each quantity."""
    main = boards[0]
    lines = []
    for name in main.estimates:
        title = without_version(name).partition("-")[0]
        panels = [
            Panel(
                board.in_shown_units(name),
                board.column.header,
                "" if k else title,
                board.column.factor * board.data[name] if name in board.data else None,
                board.column.key if k else "",
            )
            for k, board in enumerate(boards)
            if name in board.estimates
        ]
        lines.append(PanelLine(main.ranking(name), panels))
    looks = family_looks(main.families)
    plot_dots(lines, looks, path, legend=family_legend(main.families, looks))
