"""The page of one dataset: replays, table of episodes, how to load it, results on it, its card."""

import shlex
from collections.abc import Sequence

import numpy as np

from swarmdata.catalogue.elements import Html, element, join
from swarmdata.catalogue.entries import Entry
from swarmdata.catalogue.pages.card_html import card_html
from swarmdata.catalogue.pages.figures_shown import count, megabytes, percent, score
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.catalogue.pages.results_tables import outcomes_table
from swarmdata.catalogue.pages.viewer_parts import browser_part, series_viewer, world_viewer
from swarmdata.catalogue.result_sources import ResultSource
from swarmdata.datasets.action_scaling import action_scale, has_choices
from swarmdata.errors import SchemaError
from swarmdata.specs.origins import Spec
from swarmdata.store.cache import cache_folder

TABLE_SCRIPTS = ("core.js", "data.js", "histograms.js", "episode_table.js", "sorting.js")
VIEWER_SCRIPTS = (*TABLE_SCRIPTS, "link.js", "player.js", "viewer.js")
WORLD_SCRIPTS = (
    *VIEWER_SCRIPTS,
    *("replay.js", "rays.js", "pen.js", "marks.js", "robots.js", "signals.js", "view.js"),
    *("track.js", "events.js", "world_page.js"),
)
SERIES_SCRIPTS = (*VIEWER_SCRIPTS, "lines.js", "pictures.js", "series_page.js")


def dataset_page(
    entry: Entry, spec: Spec, n_shown: int, peers: Sequence[str], sources: Sequence[ResultSource]
) -> Page:
    """Returns the page of a dataset.

    Args:
        entry: of the dataset.
        spec: through whose models its episodes are shown.
        n_shown: episodes that are shown; 0: none.
        peers: ids of other datasets in the same world, to show beside it.
        sources: all results; those on this dataset are listed.
    """
    is_world = spec.world is not None
    scripts: tuple[str, ...] = ("core.js", "sorting.js", "ready.js")
    viewer = _absent(entry)
    if n_shown:
        scripts = WORLD_SCRIPTS if is_world else SERIES_SCRIPTS
        shown = series_viewer()
        if spec.world is not None and entry.spec.world is not None:
            shown = world_viewer(spec.world, entry.spec.world)
        browser = browser_part(_sample(entry, n_shown), has_collisions=is_world)
        viewer = element("div", shown, browser, class_="dataset")
    body = join(
        element("p", element("a", "‹ All datasets", href="../index.html"), class_="crumbs"),
        element("h1", entry.id),
        _facts(entry),
        viewer,
        _loading(entry, spec),
        _results(entry, sources),
        _card(entry),
    )
    data = {"key": entry.key, "peers": list(peers), "root": "../"}
    return Page(f"datasets/{entry.key}.html", f"{entry.id}: swarmdata", body, scripts, data)


def _facts(entry: Entry) -> Html:
    facts = [
        ("task", entry.spec.task),
        ("tier", entry.tier),
        ("robots" if entry.spec.world else "agents", str(entry.spec.n_agents)),
        ("success", percent(entry.success)),
        ("without contact", percent(entry.clean_success)),
        ("score", score(entry.score)),
        ("episodes", "–" if entry.n_episodes is None else f"{entry.n_episodes:,}"),
        ("joint steps", f"{entry.n_steps:,}"),
        ("size", megabytes(entry.n_bytes)),
    ]
    figures = [element("div", element("dt", name), element("dd", value)) for name, value in facts]
    return element("dl", *figures, class_="facts")


def _absent(entry: Entry) -> Html:
    text = join(
        "The episodes of this dataset are not in this catalogue. ",
        element("code", f"swarmdata catalogue build {entry.id}"),
        " makes one with its replays.",
    )
    return element("p", text, class_="absent")


def _sample(entry: Entry, n_shown: int) -> str:
    """How many of the episodes are shown."""
    if n_shown == entry.n_episodes:
        return f"All {count(n_shown, 'episode')} of the dataset."
    return (
        f"{n_shown:,} of {entry.n_episodes:,} episodes: every policy and outcome has its share, "
        "evenly spaced."
    )


def _loading(entry: Entry, spec: Spec) -> Html:
    name = _name_to_load(entry)
    models = ""
    if spec != entry.spec and spec.world is not None:
        models = "  # replayed here through other sensors or radios: see dataset.reobserve"
    python = f'import swarmdata\n\ndataset = swarmdata.load("{name}"){models}\nepisode = dataset[0]'
    codes = {"python": python}
    if _is_learned(entry):
        codes["python"] += "\nbatch = next(dataset.sampler(256))"
        codes["shell"] = f"swarmdata train bc {shlex.quote(name)} --out runs/bc"
    parts = [element("h2", "Load it", id="load")]
    for key, text in codes.items():
        button = element(
            "button",
            "Copy",
            type="button",
            data_copies=f"copy-{key}",
            aria_label=f"Copy {key} code",
        )
        code = element("code", text, id=f"copy-{key}")
        parts.append(element("div", element("pre", code, tabindex="0"), button, class_="snippet"))
    return element("section", *parts, aria_labelledby="load")


def _name_to_load(entry: Entry) -> str:
    """What `load` takes: the id of a published or cached dataset, else an address or a folder."""
    dataset = entry.dataset
    is_cached = dataset is not None and dataset.path == cache_folder() / "datasets" / entry.id
    if dataset is None or is_cached or dataset.source in ("cache", "rebuilt"):
        return entry.id
    return dataset.path.resolve().name if dataset.source == "folder" else dataset.source


def _is_learned(entry: Entry) -> bool:
    """Whether algorithms learn from it: images and actions without bounds are for other code."""
    if entry.dataset is None or entry.spec.world is not None:
        return True
    if entry.dataset.recipe.missing is not None or entry.dataset[0].observations.dtype == np.uint8:
        return False
    try:
        return bool(has_choices(entry.spec)) or bool(action_scale(entry.spec))
    except SchemaError:
        return False


def _results(entry: Entry, sources: Sequence[ResultSource]) -> Html:
    found = [
        (each, outcome)
        for each in sources
        for outcome in each.outcomes
        if outcome.dataset.partition("@")[0] == entry.id
    ]
    if not found:
        return join()
    link = element("a", "all results", href="../results.html")
    return element(
        "section",
        element("h2", "Results on it", id="results"),
        element("p", "What algorithms learned from it, with 95 % intervals; see ", link, "."),
        outcomes_table("outcomes", found, root="../", has_dataset=False),
        aria_labelledby="results",
    )


def _card(entry: Entry) -> Html:
    title = element("h2", "Card", id="card")
    if entry.card is None:
        text = element(
            "p",
            "This dataset has no card yet: ",
            element("code", f"swarmdata card {entry.id} --write"),
        )
        return element("section", title, text, aria_labelledby="card")
    inside = element("details", element("summary", "The whole card"), card_html(entry.card))
    return element("section", title, inside, class_="card-text", aria_labelledby="card")
