"""Tables of what algorithms achieved, with links to the pages of their datasets."""

from collections.abc import Sequence

from swarmdata.catalogue.elements import Html, element
from swarmdata.catalogue.pages.figures_shown import interval
from swarmdata.catalogue.result_sources import Outcome, ResultSource

QUANTITIES = (
    ("score", "score", 1.0, 1),
    ("return", "return", 1.0, 2),
    ("success", "success (%)", 100.0, 1),
    ("clean_success", "clean success (%)", 100.0, 1),
    ("robot_collisions", "robot collisions", 1.0, 2),
    ("obstacle_collisions", "obstacle collisions", 1.0, 2),
)
"""Columns: key, head, factor to the shown unit, decimals."""

LOW_IS_BETTER = frozenset({"robot_collisions", "obstacle_collisions"})
"""Columns of which the best is the lowest."""


def outcomes_table(
    key: str,
    found: Sequence[tuple[ResultSource, Outcome]],
    *,
    root: str,
    has_dataset: bool,
    known: frozenset[str] = frozenset(),
) -> Html:
    """Returns a table that is sorted by a click on its heads.

    Args:
        key: of the table in its page.
        found: its rows, with where they come from.
        root: path to the top of the catalogue.
        has_dataset: whether the datasets are a column.
        known: ids of datasets that have a page, which rows link to.
    """
    names = ["algorithm", *(["dataset"] if has_dataset else []), "family"]
    numbers = [("seeds", False), ("updates", False)]
    numbers += [(head, key in LOW_IS_BETTER) for key, head, *_ in QUANTITIES]
    rows = []
    for source, outcome in found:
        dataset = [_dataset(outcome, root, known)] if has_dataset else []
        cells = [
            *dataset,
            element("td", outcome.family),
            _number(str(outcome.n_runs or "–"), outcome.n_runs),
            _number(outcome.updates or "–", outcome.updates),
            *(_estimate(outcome, name, factor, digits) for name, _, factor, digits in QUANTITIES),
            element("td", source.title, class_="source", title=_source(source, outcome)),
        ]
        rows.append(element("tr", _label(outcome, root), *cells))
    head = element(
        "tr",
        *(element("th", name, scope="col") for name in names),
        *(
            element("th", name, scope="col", class_="n", data_low="yes" if is_low else None)
            for name, is_low in numbers
        ),
        element("th", "source", scope="col"),
    )
    inside = element(
        "table", element("thead", head), element("tbody", *rows), class_="sortable", id=key
    )
    return element("div", inside, class_="wide", tabindex="0", role="region", aria_label="Results")


def _label(outcome: Outcome, root: str) -> Html:
    """The name of an outcome, which leads to its runs and episodes."""
    note = f" rewards {outcome.rewards}" if outcome.rewards else ""
    name: Html | str = outcome.label
    if outcome.key:
        name = element("a", name, href=f"{root}results/{outcome.key}.html")
    inside = [name, *([element("small", note)] if note else [])]
    return element("th", *inside, scope="row")


def _dataset(outcome: Outcome, root: str, known: frozenset[str]) -> Html:
    name = outcome.dataset.partition("@")[0]
    if name not in known:
        return element("td", outcome.dataset)
    return element("td", element("a", outcome.dataset, href=f"{root}datasets/{name}.html"))


def _number(text: str, value: object) -> Html:
    return element("td", text, class_="n", data_value=value or 0)


def _estimate(outcome: Outcome, name: str, factor: float, decimals: int) -> Html:
    found = outcome.estimates.get(name)
    text = interval(found, factor, decimals)
    value = -1e9 if found is None or found.value != found.value else found.value
    return element("td", text, class_="n", data_value=f"{value:.8g}")


def _source(source: ResultSource, outcome: Outcome) -> str:
    runs = f"; runs {', '.join(outcome.runs)}" if outcome.runs else ""
    return f"{source.place}{runs}"
