"""The results page: a chart for each dataset, the leaderboard, learning curves and robustness."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.catalogue.drawings.charts import Bar, estimate_chart, line_chart
from swarmdata.catalogue.elements import Html, element, join
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.catalogue.pages.results_tables import outcomes_table
from swarmdata.catalogue.result_sources import Outcome, ResultSource
from swarmdata.drawing.style import COLORS, GRAY, SPARE_COLORS, family_colors
from swarmdata.rollouts.score_statistics import Estimate

MOST_ROWS = 24
"""Rows of a chart; the table has all."""

Found = tuple[ResultSource, Outcome]


def results_page(sources: Sequence[ResultSource], known: frozenset[str]) -> Page:
    """Returns the page of results.

    Args:
        sources: of studies and of one's own.
        known: ids of datasets that have a page.
    """
    found = _distinct(sources)
    body = join(
        element("h1", "Results"),
        element(
            "p",
            "What offline algorithms learned from the datasets, measured on reserved evaluation "
            "seeds. Score 0 is the better of an idle and a random team, 100 the expert. Lines are "
            "95 % intervals, the dashed line is the mean score of the dataset's own episodes. The "
            "name of an algorithm leads to its runs and episodes.",
            class_="lead",
        ),
        *([_leaderboard(found, known)] if found else [_nothing()]),
        element(
            "div",
            *(_figure(dataset, found, sources, known) for dataset in _datasets(found)),
            class_="figures",
        ),
        *(_charts(each) for each in sources if each.charts),
    )
    scripts = ("core.js", "sorting.js", "ready.js")
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


def _datasets(found: Sequence[Found]) -> list[str]:
    return sorted({outcome.dataset for _, outcome in found})


def _leaderboard(found: Sequence[Found], known: frozenset[str]) -> Html:
    label = "Filter by algorithm, dataset, family or source"
    field = element(
        "input", type="search", data_filters="leaderboard", placeholder=label, aria_label=label
    )
    ranked = sorted(found, key=lambda each: (*_rank(each[1]), each[1].dataset, each[1].label))
    return element(
        "section",
        element("h2", "Leaderboard", id="leaders"),
        element("div", field, class_="search"),
        outcomes_table("leaderboard", ranked, root="", has_dataset=True, known=known),
        aria_labelledby="leaders",
    )


def _quantity(outcomes: Sequence[Outcome]) -> str:
    """The score where all have it, else the return."""
    return "score" if all("score" in each.estimates for each in outcomes) else "return"


def _rank(outcome: Outcome) -> tuple[int, float]:
    """Sorts the best first: those with a score, then those with a return, which has no scale."""
    for k, name in enumerate(("score", "return")):
        found = outcome.estimates.get(name)
        if found is not None and not math.isnan(found.value):
            return k, -found.value
    return 2, 0.0


def _distinct(sources: Sequence[ResultSource]) -> list[Found]:
    """The outcomes; what several sources measured alike, such as shared cells, is there once."""
    found: dict[tuple[object, ...], Found] = {}
    for source in sources:
        for each in source.outcomes:
            numbers = tuple(sorted((name, repr(value)) for name, value in each.estimates.items()))
            key = (each.dataset, each.label, each.rewards, each.n_runs, each.updates, numbers)
            found.setdefault(key, (source, each))
    return list(found.values())


def _figure(
    dataset: str, found: Sequence[Found], sources: Sequence[ResultSource], known: frozenset[str]
) -> Html:
    here = [each for each in found if each[1].dataset == dataset]
    quantity = _quantity([outcome for _, outcome in here])
    ranked = sorted(here, key=lambda each: _rank(each[1]))
    colors = family_colors(sorted({outcome.family for _, outcome in found}))
    known_colors = (*COLORS, GRAY, *SPARE_COLORS)
    series = {family: known_colors.index(color) for family, color in colors.items()}
    repeated = Counter(outcome.label for _, outcome in here)
    bars = [
        _bar(source, outcome, quantity, series, is_repeated=repeated[outcome.label] > 1)
        for source, outcome in ranked[:MOST_ROWS]
    ]
    data = next((each.data[dataset] for each in sources if dataset in each.data), None)
    chart = estimate_chart(
        bars,
        quantity,
        f"{quantity} by algorithm on {dataset}",
        data if quantity == "score" else None,
    )
    name = dataset.partition("@")[0]
    title: Html | str = dataset
    if name in known:
        title = element("a", dataset, href=f"datasets/{name}.html")
    used = [family for family in series if any(o.family == family for _, o in here)]
    key = [element("span", family, class_=f"key series-{series[family]}") for family in used]
    left_out = len(ranked) - len(bars)
    note = (
        [element("p", f"The {left_out} lowest rows are in the table only.")] if left_out > 0 else []
    )
    return element(
        "section", element("h2", title), element("p", *key), chart, *note, class_="figure"
    )


def _bar(
    source: ResultSource,
    outcome: Outcome,
    quantity: str,
    series: Mapping[str, int],
    *,
    is_repeated: bool,
) -> Bar:
    undefined = Estimate(math.nan, math.nan, math.nan)
    label = f"{outcome.label} *" if outcome.rewards else outcome.label
    if is_repeated:
        label += f" ({Path(source.place).name})"
    runs = f"{outcome.n_runs} training seeds; {source.title}"
    if outcome.rewards:
        runs += f"; learned from rewards {outcome.rewards}"
    if outcome.runs:
        runs += f"; runs {', '.join(outcome.runs)}"
    estimate = outcome.estimates.get(quantity, undefined)
    href = f"results/{outcome.key}.html" if outcome.key else ""
    return Bar(label, estimate, series[outcome.family], runs, href)


def _charts(source: ResultSource) -> Html:
    parts = []
    for each in source.charts:
        chart = line_chart(each.lines, each.x_name, each.y_name, f"{each.title}, {source.title}")
        parts.append(element("figure", element("figcaption", each.title), chart))
    return element("section", element("h2", source.title), element("div", *parts, class_="figures"))
