"""Builds a catalogue: entries, data files, drawings and pages, in one new folder."""

import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from time import perf_counter

import numpy as np

from swarmdata.catalogue.boards import Board, boards
from swarmdata.catalogue.drawings.charts import rewards_drawing
from swarmdata.catalogue.drawings.episode_drawing import episode_drawing
from swarmdata.catalogue.elements import Html
from swarmdata.catalogue.entries import Entry, find_entries
from swarmdata.catalogue.pages.dataset_page import dataset_page
from swarmdata.catalogue.pages.index_page import index_page
from swarmdata.catalogue.pages.measured_page import measured_page
from swarmdata.catalogue.pages.page_frame import Page, render
from swarmdata.catalogue.pages.results_page import results_page
from swarmdata.catalogue.replays.data_files import choose_episodes, write_data
from swarmdata.catalogue.replays.measured_files import play_again, write_measured
from swarmdata.catalogue.result_sources import (
    Outcome,
    ResultSource,
    committed_sources,
    entry_sources,
    own_sources,
    results_on,
    studies_without_episodes,
    with_differences,
    with_keys,
)
from swarmdata.catalogue.site_folder import CATALOGUE
from swarmdata.datasets.dataset import Dataset
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.output_folder import check_output, filled
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.model_choice import Source, check_messages, chosen_models, with_models
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.origins import Spec

DEFAULT_EPISODES = 1000  # episodes shown of a dataset, unless another number is asked for


@dataclass(frozen=True)
class CatalogueChoices:
    """What a catalogue shows."""

    episodes: int | None = DEFAULT_EPISODES  # most of each dataset; None: all
    results: tuple[Path, ...] = ()  # folders and files with results of one's own
    entries: Path | None = None  # folder with entries of a leaderboard, which are verified
    observation: Source | None = None  # model through which replays are shown, not the recorded one
    communication: Source | None = None  # likewise
    workers: int | None = None  # processes that build datasets
    published: bool = True
    """Whether published datasets whose episodes are not shown have pages too, and all committed
    results; if not, there are only the datasets that are named and their results."""


def build_catalogue(
    names: Sequence[str],
    out: Path,
    choices: CatalogueChoices,
    *,
    note: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes a catalogue and returns its index page; an earlier one is replaced at the end.

    Names are as `find_entries` takes them. A dataset or a result that cannot be shown does not keep
    the others from it. `note` is told what is being done.

    Raises:
        OutputError: something else is at `out`.
        SpecError: a model is malformed.
        SwarmdataError: the only dataset or result that was named cannot be read.
        BatchError: some datasets or results cannot be shown; all others are.
    """
    check_output(out, CATALOGUE)
    _check_models(choices)
    start = perf_counter()
    failures = Failures(len(names) + len(choices.results), note)
    own = own_sources(choices.results, failures, [p for p in map(Path, names) if p.is_dir()])
    verified = [] if choices.entries is None else entry_sources(choices.entries, failures)
    entries = find_entries(
        names, failures, workers=choices.workers, with_published=choices.published
    )
    failures.n_items = len(entries) + len(failures.reasons) + len(own) + len(verified)
    committed, verified = _compared(entries, own, verified, all_committed=choices.published)
    if lacking := studies_without_episodes():
        note(
            f"{len(lacking)} committed studies are shown without pages of their episodes, which "
            "only a clone of the repository has, in cards/studies"
        )
    sources = with_keys([*committed, *own, *verified])
    with filled(out, CATALOGUE, whole=True) as site:
        with as_file(files("swarmdata.catalogue").joinpath("assets")) as assets:
            shutil.copytree(assets, site / "assets")
        shown = _write_episodes(site, entries, choices, failures)
        known = frozenset(each.entry.id for each in shown)
        sources = _write_results(site, sources, known, failures)
        found = boards(sources)
        entries = [each.entry for each in shown]
        shown = [each for each in shown if _write_page(site, each, entries, found, failures)]
        pictures = {each.entry.id: each.picture for each in shown}
        _write(site, index_page([each.entry for each in shown], pictures))
        _write(site, results_page(found, sources, known))
        n_pages = sum(1 for _ in site.rglob("*.html"))
        note(f"{n_pages} pages, {_size(site)}, {perf_counter() - start:.0f} s")
    failures.check("datasets and results", f"The others are in {out / 'index.html'}.")
    return out / "index.html"


def _compared(
    entries: Sequence[Entry],
    own: Sequence[ResultSource],
    verified: Sequence[ResultSource],
    *,
    all_committed: bool,
) -> tuple[list[ResultSource], list[ResultSource]]:
    """The committed results that are shown, and the verified entries compared with the zoo."""
    shown = {entry.id for entry in entries}
    beside = {each.dataset.partition("@")[0] for source in own for each in source.outcomes}
    entered = {outcome.dataset for source in verified for outcome in source.outcomes}
    committed = committed_sources(None if all_committed else shown | beside | entered)
    compared = with_differences(verified, committed)
    if not all_committed:
        committed = results_on(committed, shown, beside | {entry.full_id for entry in entries})
    return committed, compared


def _check_models(choices: CatalogueChoices) -> None:
    """Raises `SpecError` or `UnknownNameError` where the text of a model is malformed."""
    for source, read in (
        (choices.observation, observation_model),
        (choices.communication, communication_model),
    ):
        if isinstance(source, str | Path | Mapping):
            read(source)


@dataclass(frozen=True, eq=False)
class _Shown:
    """A dataset whose picture and data files are there."""

    entry: Entry
    spec: Spec  # with the models through which its episodes are shown
    picture: Html
    n_episodes: int


def _write_episodes(
    site: Path, entries: Sequence[Entry], choices: CatalogueChoices, failures: Failures
) -> list[_Shown]:
    """Draws each dataset and writes its data files; those that fail are left out."""
    drawn: Counter[str] = Counter()  # starts, by hash of the spec
    found = []
    for entry in entries:
        folder, n_shown, began = site / "data" / entry.id, 0, perf_counter()
        with failures.item(entry.id):
            spec, picture = _shown_spec(entry, choices), _draw(entry, drawn)
            if entry.dataset is not None:
                episodes = choose_episodes(entry.dataset.episodes, choices.episodes)
                n_shown = len(episodes)
                write_data(entry.dataset, spec, episodes, folder)
                spent = perf_counter() - began
                failures.tell(f"{entry.id}: {n_shown:,} episodes, {_size(folder)}, {spent:.1f} s")
            found.append(_Shown(entry, spec, picture, n_shown))
            continue
        shutil.rmtree(folder, ignore_errors=True)
    return found


def _write_page(
    site: Path, one: _Shown, entries: Sequence[Entry], results: Sequence[Board], failures: Failures
) -> bool:
    """Writes the page of a dataset, and says whether that went well."""
    with failures.item(one.entry.id):
        page = dataset_page(one.entry, one.spec, one.n_episodes, one.picture, entries, results)
        _write(site, page)
        return True
    return False


def _shown_spec(entry: Entry, choices: CatalogueChoices) -> Spec:
    """The spec with the models through which the episodes of a dataset are shown."""
    spec = entry.spec.world
    if spec is None or (choices.observation is None and choices.communication is None):
        return entry.spec
    models = choices.observation, choices.communication
    if entry.dataset is None:  # no episodes are shown, so there is nothing to say
        return with_models(spec, *models)
    found = chosen_models(spec, *models)
    check_messages(found, spec)
    return found


def _write_results(
    site: Path, sources: Sequence[ResultSource], known: frozenset[str], failures: Failures
) -> list[ResultSource]:
    """Writes a page with the runs and episodes of each outcome; one that fails has none."""

    def written(source: ResultSource, outcome: Outcome) -> Outcome:
        if not outcome.key:
            return outcome
        with failures.item(f"{outcome.label} on {outcome.dataset} of {source.place}"):
            played = play_again(outcome.results, failures.tell)
            write_measured(outcome.results, played, site / "data" / outcome.key)
            _write(site, measured_page(source, outcome, len(played), known))
            return outcome
        shutil.rmtree(site / "data" / outcome.key, ignore_errors=True)
        return replace(outcome, key="")

    return [each.with_outcomes(written) for each in sources]


def _draw(entry: Entry, drawn: Counter[str]) -> Html:
    """The episode of median return, or the next start of a world without episodes."""
    spec = entry.spec.world
    if entry.dataset is not None:
        return _draw_median(entry.dataset)
    if spec is None:
        return Html("")
    drawn[spec.hash()] += 1
    start = make_env(spec).reset(evaluation_seeds(drawn[spec.hash()])[-1:])
    label = f"The start of an episode of {spec.task}"
    return episode_drawing(spec, start.layouts[0], start.states, label)


def _draw_median(dataset: Dataset) -> Html:
    returns = dataset.episodes.team_return
    middle = int(np.argsort(returns, kind="stable")[len(returns) // 2])
    episode = dataset[middle]
    label = f"Episode {middle} of {dataset.id}, of median return"
    spec = dataset.recipe.spec.world
    if spec is None:
        return rewards_drawing(episode.rewards, f"{label}: rewards so far, by agent")
    return episode_drawing(spec, episode.layout, episode.states, label)


def _write(site: Path, page: Page) -> None:
    path = site / page.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render(page), encoding="utf-8")


def _size(folder: Path) -> str:
    n_bytes = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return f"{n_bytes / 1e6:.2f} MB"
