"""The results page: a leaderboard for each dataset, then learning curves and robustness."""

from collections.abc import Mapping, Sequence

from swarmdata.catalogue.boards import GROUPS, Board
from swarmdata.catalogue.drawings.charts import line_chart
from swarmdata.catalogue.elements import Html, element, join
from swarmdata.catalogue.pages.filters import choice, form, nothing_found
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.catalogue.pages.results_tables import (
    UNKNOWN_SERIES,
    about,
    board_table,
    entry_lines,
    family_key,
    series_of,
)
from swarmdata.catalogue.result_sources import ResultSource
from swarmdata.drawing.style import family_name

SCRIPTS = ("core.js", "filters.js", "sorting.js", "results_page.js")


def results_page(
    found: Sequence[Board], sources: Sequence[ResultSource], known: frozenset[str]
) -> Page:
    """Returns the page of results; `known` are the ids of datasets that have a page."""
    body = join(
        element("h1", "Results"),
        element(
            "p",
            "What offline algorithms learned from each dataset, measured on reserved evaluation "
            "episodes, except where the source says validation seeds. Score 0 is the better of an "
            "idle and a random team, 100 the expert. Lines are 95 % intervals, the upright line is "
            "the mean score of the dataset's own episodes.",
            class_="lead",
        ),
        *(_leaderboards(found, known) if found else [_nothing()]),
        *(_charts(each, series_of(found)) for each in sources if each.charts),
    )
    scripts = SCRIPTS if found else ("core.js", "ready.js")
    return Page("results.html", "swarmdata: results", body, scripts, {})


def _nothing() -> Html:
    return element(
        "p",
        "There are no results yet. ",
        element("code", "swarmdata catalogue build --results FOLDER"),
        " adds those of a study or of ",
        element("code", "swarmdata evaluate --out FOLDER"),
        ".",
    )


def _leaderboards(found: Sequence[Board], known: frozenset[str]) -> list[Html]:
    """The form that chooses a board and its rows, and all boards."""
    series = series_of(found)
    largest = max(found, key=lambda board: len(board.of("algorithms"))).dataset
    search = element("input", type="search", name="search", placeholder="algorithm or family")
    names = [board.dataset for board in found]
    fields = (
        choice("Dataset", "dataset", names, default=largest, every=None),
        choice("Results", "group", labels=GROUPS, default="algorithms", every="all"),
        element("label", "Search", search),
    )
    sections = [_section(board, series, known, f"board-{k}") for k, board in enumerate(found)]
    return [form("Filter results", fields), *nothing_found("results"), *sections]


def _section(board: Board, series: dict[str, int], known: frozenset[str], key: str) -> Html:
    title: Html | str = board.dataset
    if board.name in known:
        title = element("a", title, href=f"datasets/{board.name}.html")
    families = sorted({row.outcome.family for row in board.rows})
    return element(
        "section",
        element("h2", title, id=f"{key}-title"),
        element("p", about(board), class_="note"),
        *entry_lines(board),
        family_key(families, series),
        board_table(board, board.rows, series, key=key),
        class_="leaderboard",
        data_dataset=board.dataset,
        aria_labelledby=f"{key}-title",
    )


def _charts(source: ResultSource, series: Mapping[str, int]) -> Html:
    """Learning curves and sweeps, each line in the color of its family."""
    families = {outcome.label: outcome.family for outcome in source.outcomes}
    parts = []
    for each in source.charts:
        kinds = {label: families.get(label, family_name(label)) for label in each.lines}
        colors = {label: series.get(kind, UNKNOWN_SERIES) for label, kind in kinds.items()}
        title = f"{each.title}, {source.title}"
        chart = line_chart(each.lines, colors, each.x_name, each.y_name, title)
        parts.append(element("figure", element("figcaption", each.title), chart))
    inside = element("div", *parts, class_="figures")
    summary = element("summary", f"{source.title}: {len(parts)} charts")
    return element("details", summary, inside, class_="charts")
