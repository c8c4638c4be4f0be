"""Builds a catalogue: entries, data files, drawings and pages, in one new folder."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from time import perf_counter

import numpy as np

from swarmdata.catalogue.drawings.episode_drawing import episode_drawing
from swarmdata.catalogue.drawings.rewards_drawing import rewards_drawing
from swarmdata.catalogue.elements import Html
from swarmdata.catalogue.entries import Entry, find_entries
from swarmdata.catalogue.pages.dataset_page import dataset_page
from swarmdata.catalogue.pages.index_page import index_page
from swarmdata.catalogue.pages.measured_page import measured_page
from swarmdata.catalogue.pages.page_frame import Page, render
from swarmdata.catalogue.pages.results_page import results_page
from swarmdata.catalogue.replays.data_files import write_data
from swarmdata.catalogue.replays.episode_choice import choose_episodes
from swarmdata.catalogue.replays.measured_files import play_again, write_measured
from swarmdata.catalogue.result_sources import (
    ResultSource,
    committed_sources,
    own_sources,
    with_keys,
)
from swarmdata.catalogue.site_folder import CATALOGUE, copy_assets, replaced_site
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.reobservation import check_messages
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.replaced_worlds import is_simulated
from swarmdata.runtime.output_folder import check_output
from swarmdata.specs.model_choice import Source, is_same_world, with_models
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec

DEFAULT_EPISODES = 1000
"""Episodes shown of a dataset, unless another number is asked for."""


@dataclass(frozen=True)
class CatalogueChoices:
    """What a catalogue shows.

    Attributes:
        episodes: most episodes of each dataset; None: all.
        results: folders and files with results of one's own.
        observation: observation model through which replays are shown; None: the recorded one.
        communication: communication model, likewise.
        workers: processes that build datasets.
    """

    episodes: int | None = DEFAULT_EPISODES
    results: tuple[Path, ...] = ()
    observation: Source | None = None
    communication: Source | None = None
    workers: int | None = None


def build_catalogue(
    names: Sequence[str],
    out: Path,
    choices: CatalogueChoices,
    *,
    note: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes a catalogue; an earlier one at the same place is replaced when this one is complete.

    Args:
        names: ids, addresses or folders of datasets whose episodes are shown; without any, those
            in the cache.
        out: the folder.
        choices: what is shown.
        note: is told what is being done.

    Returns:
        The index page.

    Raises:
        OutputError: something else is at `out`.
        SchemaError: the results are malformed.
        SpecError: a model is malformed, or does not fit a dataset.
        SwarmdataError: a dataset or a result cannot be read.
    """
    check_output(out, CATALOGUE)
    start = perf_counter()
    sources = with_keys([*committed_sources(), *own_sources(choices.results)])
    entries = find_entries(names, note, workers=choices.workers)
    specs = {entry.id: _shown_spec(entry, choices) for entry in entries}
    known = frozenset(entry.id for entry in entries)
    with replaced_site(out) as site:
        with as_file(files("swarmdata.catalogue").joinpath("assets")) as assets:
            copy_assets(assets, site)
        drawings = _Drawings()
        pictures = {entry.id: drawings.draw(entry) for entry in entries}
        _write(site, index_page(entries, pictures))
        _write(site, results_page(sources, known))
        for entry in entries:
            n_shown, began = 0, perf_counter()
            if entry.dataset is not None:
                shown = choose_episodes(entry.dataset.episodes, choices.episodes)
                write_data(entry.dataset, specs[entry.id], shown, site / "data" / entry.key)
                n_shown = len(shown)
                size, spent = _size(site / "data" / entry.key), perf_counter() - began
                note(f"{entry.id}: {n_shown:,} episodes, {size}, {spent:.1f} s")
            peers = _peers(entry, entries)
            _write(site, dataset_page(entry, specs[entry.id], n_shown, peers, sources))
        _write_results(site, sources, known, note)
        n_pages = sum(1 for _ in site.rglob("*.html"))
        note(f"{n_pages} pages, {_size(site)}, {perf_counter() - start:.0f} s")
    return out / "index.html"


def _shown_spec(entry: Entry, choices: CatalogueChoices) -> Spec:
    """The spec with the models through which the episodes of a dataset are shown."""
    spec = entry.spec.world
    if spec is None or (choices.observation is None and choices.communication is None):
        return entry.spec
    found = with_models(spec, choices.observation, choices.communication)
    if entry.dataset is not None:
        check_messages(found, spec)
    return found


def _write_results(
    site: Path,
    sources: Sequence[ResultSource],
    known: frozenset[str],
    note: Callable[[str], None],
) -> None:
    """Writes a page with the runs and episodes of each outcome."""
    for source in sources:
        for outcome in source.outcomes:
            if outcome.key:
                played = play_again(outcome.results, note)
                folder = site / "data" / outcome.key
                write_measured(outcome.results, played, folder)
                _write(site, measured_page(source, outcome, len(played), known))


def _peers(entry: Entry, entries: Sequence[Entry]) -> list[str]:
    """Other datasets with episodes in the same world, or of the same environment."""
    if entry.dataset is None:
        return []
    others = (other for other in entries if other is not entry and other.dataset is not None)
    return [other.id for other in others if _is_comparable(entry.spec, other.spec)]


def _is_comparable(one: Spec, other: Spec) -> bool:
    if one.world is None or other.world is None:
        return one.hash() == other.hash()
    return is_same_world(one.world, other.world)


class _Drawings:
    """Draws datasets: the episode of median return, or the start of a world without episodes."""

    def __init__(self) -> None:
        self._drawn: Counter[str] = Counter()  # starts, by hash of the spec

    def draw(self, entry: Entry) -> Html:
        spec = entry.spec.world
        if entry.dataset is not None:
            return _draw_median(entry.dataset)
        if spec is None or not is_simulated(spec):
            return Html("")
        self._drawn[spec.hash()] += 1
        return _draw_start(spec, self._drawn[spec.hash()])


def _draw_median(dataset: Dataset) -> Html:
    returns = dataset.episodes.team_return
    middle = int(np.argsort(returns, kind="stable")[len(returns) // 2])
    episode = dataset[middle]
    label = f"Episode {middle} of {dataset.id}, of median return"
    spec = dataset.recipe.spec.world
    if spec is None:
        return rewards_drawing(episode.rewards, f"{label}: rewards so far, by agent")
    return episode_drawing(spec, episode.layout, episode.states, label)


def _draw_start(spec: TaskSpec, number: int) -> Html:
    """Draws a start of its own for each dataset of a world."""
    start = make_env(spec).reset(evaluation_seeds(number)[-1:])
    return episode_drawing(
        spec, start.layouts[0], start.states, f"The start of an episode of {spec.task}"
    )


def _write(site: Path, page: Page) -> None:
    path = site / page.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render(page), encoding="utf-8")


def _size(folder: Path) -> str:
    n_bytes = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return f"{n_bytes / 1e6:.2f} MB"
