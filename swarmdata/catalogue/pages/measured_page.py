"""The page of one result: its estimates, its runs, every measured episode, and replays of some."""

import math
from collections.abc import Sequence

import numpy as np

from swarmdata.catalogue.elements import Html, element, join, section, table
from swarmdata.catalogue.pages.dataset_page import TABLE_SCRIPTS, WORLD_SCRIPTS
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.catalogue.pages.results_tables import COLUMNS, zoo_difference
from swarmdata.catalogue.pages.viewer_parts import episode_table, world_viewer
from swarmdata.catalogue.replays.measured_files import measured_columns, run_names
from swarmdata.catalogue.result_sources import Outcome, ResultSource
from swarmdata.evaluation.results.estimate_table import format_estimate, format_number
from swarmdata.evaluation.results.result_files import Result

HEADS = {
    "index": "episode",
    "policy": "run",
    "end": "outcome",
    "return": "return",
    "time": "time to goal (s)",
    "collisions": "collisions",
}


def measured_page(
    source: ResultSource, outcome: Outcome, n_replays: int, known: frozenset[str]
) -> Page:
    """Returns the page of a result."""
    spec = outcome.results[0].spec
    viewer: Html = element("p", id="notice", role="status")
    scripts: tuple[str, ...] = (*TABLE_SCRIPTS, "measured_page.js")
    if n_replays and spec.world is not None:
        viewer, scripts = world_viewer(spec.world, spec.world), WORLD_SCRIPTS
    columns = {key: HEADS[key] for key in measured_columns(outcome.results)}
    n = len(outcome.results[0].evaluation.seeds)
    text = f"All {n:,} measured episodes of each run, numbered by their evaluation seeds."
    if n_replays:
        text += (
            f" The {n_replays} marked by ▶ have replays: the lowest, median and highest returns."
        )
    inside = join(viewer, episode_table(columns, text, {"policy": "Run"}))
    body = join(
        element("p", element("a", "‹ All results", href="../results.html"), class_="crumbs"),
        element("h1", f"{outcome.label} on ", _dataset(outcome, known)),
        _facts(source, outcome),
        element("div", inside, class_="halves" if n_replays else None),
        _runs(outcome.results),
    )
    absent = _why_absent(outcome, n_replays)
    data = {"key": outcome.key, "peers": [], "root": "../", "absent": absent}
    title = f"{outcome.label} on {outcome.dataset}: swarmdata"
    return Page(f"results/{outcome.key}.html", title, body, scripts, data)


def _dataset(outcome: Outcome, known: frozenset[str]) -> Html | str:
    name = outcome.dataset.partition("@")[0]
    if name not in known:
        return outcome.dataset
    return element("a", outcome.dataset, href=f"../datasets/{name}.html")


def _facts(source: ResultSource, outcome: Outcome) -> Html:
    facts = [
        ("source", source.title),
        ("family", outcome.family),
        ("training seeds", str(outcome.n_runs)),
        ("updates", outcome.updates or "–"),
    ]
    if outcome.rewards:
        facts.append(("rewards", outcome.rewards))
    for key, column in COLUMNS.items():
        if key in outcome.estimates:
            facts.append((column.header, format_estimate(outcome.estimates[key], column)))
    if outcome.difference is not None:
        facts.append(("score difference", zoo_difference(outcome.difference)))
    figures = [join(element("dt", name), element("dd", value)) for name, value in facts]
    return element("dl", *figures, class_="facts across")


def _why_absent(outcome: Outcome, n_replays: int) -> str:
    """What is said of an episode without a replay."""
    run = outcome.results[0].run_name
    if n_replays and run is not None:
        return (
            f"has no replay here. swarmdata render {run} --episode NUMBER --out clip.gif plays "
            "any episode of the first training seed."
        )
    return (
        "has no replay: a result keeps metrics and seeds, and the policies of this one are not at "
        "hand."
    )


def _runs(results: Sequence[Result]) -> Html:
    shown = [  # without the score, which the estimates have
        column
        for key, column in COLUMNS.items()
        if key != "score" and not all(math.isnan(_mean(one, key)) for one in results)
    ]
    is_kept = any(result.run_name for result in results)
    rows: list[tuple[object, ...]] = []
    for name, result in zip(run_names(results), results, strict=True):
        figures = [format_number(_mean(result, column.key), column) for column in shown]
        rows.append((name, *figures, *([result.run_name or "not kept"] if is_kept else [])))
    head = ("run", *(column.header for column in shown), *(["run folder"] if is_kept else []))
    text = element("p", "Means over the episodes of each training seed.")
    return section("Runs", "runs", text, table(head, rows))


def _mean(result: Result, name: str) -> float:
    values = result.evaluation.metrics.get(name)
    return math.nan if values is None else float(np.mean(values))
