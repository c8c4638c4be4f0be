"""Tables of what algorithms achieved on a dataset, with a drawing of each interval."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.catalogue.boards import Board, Row
from swarmdata.catalogue.drawings.charts import Axis, axis_drawing, interval_drawing, score_axis
from swarmdata.catalogue.elements import Html, element
from swarmdata.catalogue.pages.figures_shown import score
from swarmdata.catalogue.result_sources import VALIDATED, Outcome, ZooDifference
from swarmdata.drawing.style import COLORS, GRAY, SPARE_COLORS, family_colors, words_of
from swarmdata.evaluation.results.estimate_table import Column, format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES, UNDEFINED_ESTIMATE

COLUMNS = {key: each.column for key, each in QUANTITIES.items() if key != "time_to_goal"}

UNKNOWN_SERIES = 6  # the gray of lines whose family is not known

RANKS = ("score", "return")  # columns by one of which a table is ranked; the other says the same

LOW_IS_BETTER = frozenset({"robot_collisions", "obstacle_collisions"})
"""Columns of which the best is the lowest."""

LEAST_SCORE = -50.0  # scores below are arrows: a team that only collides would squeeze all others


def series_of(results: Sequence[Board]) -> dict[str, int]:
    """The number of each family's color in the style sheet, the same on all pages."""
    families = sorted({row.outcome.family for board in results for row in board.rows})
    known = (*COLORS, GRAY, *SPARE_COLORS)
    return {kind: known.index(color) for kind, color in family_colors(families).items()}


def family_key(families: Sequence[str], series: Mapping[str, int]) -> Html:
    """A line that says which color is which family."""
    keys = [element("span", each, class_=f"key series-{series[each]}") for each in families]
    return element("p", *keys, class_="keys")


def about(board: Board) -> str:
    """Where the first group of a board comes from, and what the data score."""
    text = "" if board.data is None else f"The data score {score(board.data)}. "
    rows = [row.outcome for row in board.of("algorithms") if not row.source.is_own]
    if board.study is None or not rows:
        return f"{text}No committed study has compared algorithms on it."
    seeds = " or ".join(sorted({str(outcome.n_runs) for outcome in rows}))
    updates = f"{int(rows[0].updates):,} updates, " if rows[0].updates else ""
    return f"{text}Rows of the study {board.study.title}: {updates}{seeds} training seeds each."


def entry_lines(board: Board) -> list[Html]:
    """The verified entries, the oldest first, with their scores: a line for each."""
    rows = [row for row in board.rows if row.source.is_verified]
    rows.sort(key=lambda row: (row.source.submitted, row.outcome.label))
    return [_entry_line(row, board.quantity) for row in rows]


def _entry_line(row: Row, quantity: str) -> Html:
    found, difference = row.outcome.estimates[quantity], row.outcome.difference
    text = f": {quantity} {format_estimate(found, COLUMNS[quantity])}"
    if difference is not None:
        text += f", {zoo_difference(difference)}, paired by episode"
    day = f"{row.source.submitted} " if row.source.submitted else ""
    return element("p", day, element("strong", row.outcome.label), f"{text}.", class_="note")


def zoo_difference(found: ZooDifference) -> str:
    """A difference with its interval and the run, such as `+3.1 [1.2, 5.0] relative to zoo:...`."""
    sign = "+" if round(found.score.value, 1) > 0 else ""
    return f"{sign}{format_estimate(found.score, COLUMNS['score'])} relative to {found.run}"


def board_table(board: Board, rows: Sequence[Row], series: Mapping[str, int], *, key: str) -> Html:
    """Returns the full table of a board, which is sorted by a click on its heads."""
    first = board.quantity
    others = [column for key, column in COLUMNS.items() if key not in RANKS]
    axis = _axis(board, rows)
    body = [
        element(
            "tr",
            *_ranked(board, row, axis, series, ""),
            *(_estimate(row.outcome, each) for each in others),
            _number(str(row.outcome.n_runs or "–"), row.outcome.n_runs),
            _number(row.outcome.updates or "–", row.outcome.updates),
            element("td", row.outcome.family),
            _source(row),
            data_group=row.group,
            data_text=_searched(row),
        )
        for row in rows
    ]
    numbers = [(each.header, each.key in LOW_IS_BETTER) for each in others]
    numbers += [("seeds", False), ("updates", False)]
    head = (
        *_ranked_heads(first, axis),
        *(_head(name, is_low=is_low) for name, is_low in numbers),
        element("th", "family", scope="col"),
        element("th", "source", scope="col"),
    )
    return _table(head, body, class_="board sortable", id=key)


def brief_table(board: Board, rows: Sequence[Row], series: Mapping[str, int], root: str) -> Html:
    """Returns a narrow table of some rows of a board, in their order."""
    axis = _axis(board, rows)
    body = [element("tr", *_ranked(board, row, axis, series, root)) for row in rows]
    return _table(_ranked_heads(board.quantity, axis), body, class_="board")


def _table(head: Sequence[Html], body: Sequence[Html], **attributes: object) -> Html:
    inside = element(
        "table", element("thead", element("tr", *head)), element("tbody", *body), **attributes
    )
    return element("div", inside, class_="wide", tabindex="0", role="region", aria_label="Results")


def _axis(board: Board, rows: Sequence[Row]) -> Axis:
    least = LEAST_SCORE if board.quantity == "score" else -math.inf
    found = [row.outcome.estimates.get(board.quantity, UNDEFINED_ESTIMATE) for row in rows]
    return score_axis(found, _data(board), least)


def _data(board: Board) -> float | None:
    return board.data if board.quantity == "score" else None


def _ranked_heads(quantity: str, axis: Axis) -> tuple[Html, ...]:
    drawn = element("th", axis_drawing(axis), scope="col", class_="drawn", data_fixed="yes")
    return element("th", "algorithm", scope="col"), _head(quantity), drawn


def _ranked(
    board: Board, row: Row, axis: Axis, series: Mapping[str, int], root: str
) -> tuple[Html, ...]:
    """The label of a row, the estimate by which it is ranked, and a drawing of it."""
    outcome = row.outcome
    found = outcome.estimates.get(board.quantity, UNDEFINED_ESTIMATE)
    drawn = interval_drawing(found, axis, _data(board), series[outcome.family])
    cell = element("td", drawn, class_="drawn")
    return _label(outcome, root), _estimate(outcome, COLUMNS[board.quantity]), cell


def _head(name: str, *, is_low: bool = False) -> Html:
    return element("th", name, scope="col", class_="n", data_low="yes" if is_low else None)


def _label(outcome: Outcome, root: str) -> Html:
    """The name of an outcome, which leads to its runs and episodes."""
    note = element("small", f" rewards {outcome.rewards}") if outcome.rewards else ""
    name: Html | str = words_of(outcome.label)
    if outcome.key:
        name = element("a", name, href=f"{root}results/{outcome.key}.html")
    return element("th", name, note, scope="row", title=outcome.label)


def _number(text: str, value: object) -> Html:
    return element("td", text, class_="n", data_value=value or 0)


def _estimate(outcome: Outcome, column: Column) -> Html:
    found = outcome.estimates.get(column.key, UNDEFINED_ESTIMATE)
    value = -1e9 if math.isnan(found.value) else found.value
    return element("td", format_estimate(found, column), class_="n", data_value=f"{value:.8g}")


def _searched(row: Row) -> str:
    label = row.outcome.label
    return f"{label} {words_of(label)} {row.outcome.family} {row.source.title}".lower()


def _source(row: Row) -> Html:
    source = row.source
    runs = f"; runs {', '.join(row.outcome.runs)}" if row.outcome.runs else ""
    mark = " (verified)" if source.is_verified else " (yours)" if source.is_own else ""
    mark += VALIDATED if VALIDATED in source.title else ""
    title = f"{source.title}, {source.place}{runs}"
    return element("td", f"{Path(source.place).name}{mark}", class_="source", title=title)
