"""Sources of results: studies, and result files of one's own, as the results page shows them.

A study's folder has `estimates.csv`, and may have `curves.csv`, `data.csv` and `sweep.csv`.
"""

import csv
import io
import math
import re
import tempfile
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

from swarmdata.cards.committed_studies import (
    ESTIMATES_FILE,
    PLAN_FILE,
    CommittedStudy,
    committed_studies,
    read_study,
)
from swarmdata.catalogue.drawings.charts import Line
from swarmdata.drawing.style import FAMILY_OF, family_name
from swarmdata.errors import DatasetNotFoundError, SchemaError
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, ResultSet, group_results, read_results
from swarmdata.evaluation.results.result_tables import estimate_with_zeros, quantities_of
from swarmdata.evaluation.runs.named_policies import family_of
from swarmdata.evaluation.study.pages.cell_archive import ARCHIVE_FILE, read_archive
from swarmdata.evaluation.study.pages.study_tables import weights_text
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.run_files import ZOO, find_run, run_hash, zoo
from swarmdata.numerics.random import VALIDATION_BASE
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double

Rows = Sequence[Mapping[str, str]]

VALIDATED = " (validation seeds)"
"""In the titles of sources on whose episodes settings may have been chosen."""


class ZooDifference(NamedTuple):
    """How an entry compares with the best run of the zoo on its dataset."""

    run: str  # its name, such as zoo:iql/coop_nav-medium-replay
    score: Estimate  # the entry's mean score minus that of the run, paired by episode


@dataclass(frozen=True)
class Outcome:
    """What one label achieved on one dataset."""

    label: str
    family: str
    dataset: str  # id with version; after @, that it was observed through other models
    estimates: Mapping[str, Estimate]  # by quantity, in stored units
    n_runs: int
    updates: str
    rewards: str  # changed weights of its rewards, JSON; empty: those of the data
    runs: tuple[str, ...]  # names of its run folders, where they are known
    results: tuple[Result, ...] = ()  # one for each run; empty: only the estimates are known
    key: str = ""  # of its page; empty: it has none
    difference: ZooDifference | None = None  # of an entry; None: the zoo has no run on its dataset


@dataclass(frozen=True)
class LineSet:
    """Lines of one chart."""

    title: str
    x_name: str
    y_name: str
    lines: Mapping[str, Line]


@dataclass(frozen=True)
class ResultSource:
    """The results of one source."""

    title: str
    place: str  # where it comes from: the name of its folder, or its path in this repository
    outcomes: tuple[Outcome, ...]  # by dataset and label
    data: Mapping[str, float]  # mean score of each dataset's own episodes, where it is known
    charts: tuple[LineSet, ...] = ()  # learning curves and sweeps
    is_own: bool = False  # it is no study of this installation
    is_verified: bool = False  # it is an entry of a leaderboard that was verified
    submitted: str = ""  # the day that an entry says, such as 2026-12-01; empty: none

    def with_outcomes(self, change: Callable[["ResultSource", Outcome], Outcome]) -> "ResultSource":
        """Returns the source with each outcome changed."""
        return replace(self, outcomes=tuple(change(self, each) for each in self.outcomes))


def committed_sources(shown: Container[str] | None = None) -> list[ResultSource]:
    """The studies that are part of this installation.

    Results have their episodes where they are on the datasets `shown`, or on any if it is None,
    which takes a second or more for each study that has some.
    """
    with as_file(files("swarmdata.cards").joinpath("studies")) as folder:
        return [
            _of_study(study, folder / study.name, f"cards/studies/{study.name}", shown)
            for study in committed_studies()
            if not study.chose_settings
        ]


def studies_without_episodes() -> list[str]:
    """Names of the committed studies whose episodes are not part of this installation."""
    shown = (study for study in committed_studies() if not study.chose_settings)
    return [each.name for each in shown if not each.folder.joinpath(ARCHIVE_FILE).is_file()]


def results_on(
    sources: Sequence[ResultSource], datasets: Container[str], beside: Container[str] = ()
) -> list[ResultSource]:
    """Returns the results on some datasets, by their ids, without sources that have none.

    Results on the datasets `beside` them have no pages of their episodes.
    """
    found = []
    for source in sources:
        named = [(each, each.dataset.partition("@")[0]) for each in source.outcomes]
        kept = [
            each if name in datasets else replace(each, results=())
            for each, name in named
            if name in datasets or name in beside
        ]
        if kept:
            found.append(replace(source, outcomes=tuple(kept)))
    return found


def own_sources(
    places: Sequence[Path], failures: Failures, data: Sequence[Path] = ()
) -> list[ResultSource]:
    """Reads studies, folders of `swarmdata evaluate --out` and result files; some may fail.

    Folders of datasets that are neither published nor in the cache are named as `data`.
    """
    found = []
    for place in places:
        with failures.item(str(place)):
            found.append(replace(_of_place(place, data), is_own=True))
    return found


def entry_sources(folder: Path, failures: Failures) -> list[ResultSource]:
    """Verifies the entries in the folders of a folder, by name; a later copy of one is refused.

    Those that pass have the metrics that the verification evaluated, not those of their files.
    """
    require_extra("torch", "torch", "verifying entries")
    from swarmdata.evaluation.leaderboard.entry import ENTRY, Description  # noqa: PLC0415  (torch)
    from swarmdata.evaluation.leaderboard.verify import verify  # noqa: PLC0415  (torch)

    places = sorted(each.parent for each in folder.glob(f"*/{ENTRY}"))
    if not places:
        raise DatasetNotFoundError(f"there are no entries of a leaderboard in {folder}")
    failures.n_items += len(places)
    found, owners = [], dict[bytes, Path]()
    for place in places:
        with failures.item(str(place)):
            verdict = verify(place)
            if not verdict.is_verified:
                raise SchemaError(f"it is rejected: {'; '.join(verdict.reasons)}")
            played = [each.evaluation.metrics["return"].tobytes() for each in verdict.results]
            if owner := next((owners[each] for each in played if each in owners), None):
                raise SchemaError(
                    f"a policy ends every episode as one of {owner} does: one of the two entries "
                    "is a copy. Name a folder with one of them."
                )
            owners |= dict.fromkeys(played, place)
            failures.tell(f"{place}: verified")
            name = place.resolve().name
            source = _of_results(group_results(verdict.results), name)
            said = Description.from_file(place / ENTRY).submitted
            day = "" if said is None else said.isoformat()
            found.append(
                replace(source, title=f"Entry {name}", is_own=True, is_verified=True, submitted=day)
            )
    return found


def with_differences(
    entries: Sequence[ResultSource], committed: Sequence[ResultSource]
) -> list[ResultSource]:
    """Compares verified entries with the zoo's best runs, whose episodes committed studies have."""
    best: dict[str, tuple[str, Outcome]] = {}
    datasets = {outcome.dataset for source in entries for outcome in source.outcomes}
    for run, outcome in _zoo_outcomes(committed, datasets):
        known = best.get(outcome.dataset)
        if known is None or _scores(outcome).mean() > _scores(known[1]).mean():
            best[outcome.dataset] = run, outcome

    def compared(_: ResultSource, entry: Outcome) -> Outcome:
        if entry.dataset not in best:
            return entry
        run, other = best[entry.dataset]
        found = difference_interval(_scores(entry), _scores(other))
        return replace(entry, difference=ZooDifference(run, found))

    return [source.with_outcomes(compared) for source in entries]


def _zoo_outcomes(
    committed: Sequence[ResultSource], datasets: Container[str]
) -> Iterator[tuple[str, Outcome]]:
    """The zoo's runs on some datasets with their results, which name the policies' files."""
    folders = {f"{ZOO}{name}": find_run(f"{ZOO}{name}") for name in zoo()}
    runs = {run_hash(run, 0): name for name, run in folders.items() if run is not None}
    for outcome in (each for source in committed for each in source.outcomes):
        if outcome.results and outcome.dataset in datasets:
            content = outcome.results[0].provenance.content
            if content in runs:
                yield runs[content], outcome


def _scores(outcome: Outcome) -> Double:
    """The scores of an outcome on a published dataset of a world, [K, E]."""
    (case,) = group_results(outcome.results, is_checked=False).cases
    return case.scores(next(iter(case.runs)))


def _of_place(place: Path, data: Sequence[Path]) -> ResultSource:
    if (place / ESTIMATES_FILE).is_file():
        return _of_study(read_study(place), place, place.resolve().name)
    if not place.exists():
        raise DatasetNotFoundError(
            f"there are no results at {place}. Name the folder of a study, one that `swarmdata "
            "evaluate --out` wrote, or a result file."
        )
    return _of_results(read_results([place], data=data), place.resolve().name)


def _board_of(case: Case) -> str:
    """The dataset of a case; after @, in which task or against whom it was measured, if elsewhere.

    What was measured elsewhere does not compare with what was measured in the recorded task.
    """
    if isinstance(case.spec, SideSpec):
        return f"{case.name}-vs-{case.spec.opponents}"
    if case.recorded in (None, case.spec) or not isinstance(case.spec, TaskSpec):
        return case.name
    preset = family_of(case.spec)
    return f"{case.name}@{preset or f'{case.spec.task}-{case.spec.hash()[:8]}'}"


def _of_results(results: ResultSet, name: str) -> ResultSource:
    outcomes, data = [], {}
    for case in (*results.cases, *results.baselines):
        board = _board_of(case)
        if case.data_score is not None:
            data[board] = case.data_score
        for label, runs in case.runs.items():
            origin = runs[0].provenance
            found = {
                each.column.key: estimate_with_zeros(each, case, label)
                for each in quantities_of(case)
            }
            names = tuple(sorted({run.run_name for run in runs if run.run_name is not None}))
            updates = "" if origin.updates is None else str(origin.updates)
            family = family_name(origin.algorithm or "policy without training")
            rewards = weights_text(case.rewards.get(label, {}))
            outcomes.append(
                Outcome(label, family, board, found, len(runs), updates, rewards, names, runs)
            )
    measured = [run.evaluation for outcome in outcomes for run in outcome.results]
    is_chosen_by = any(each.seeds[0] >= VALIDATION_BASE for each in measured)
    title = f"{name}{VALIDATED}" if is_chosen_by else name
    return ResultSource(title, name, tuple(outcomes), data)


def _of_study(
    study: CommittedStudy, folder: Path, place: str, shown: Container[str] | None = None
) -> ResultSource:
    groups: dict[tuple[str, str], list[Mapping[str, str]]] = {}
    for row in study.estimates:
        groups.setdefault((row["dataset"], row["label"]), []).append(row)
    has_shown = shown is None or any(name.partition("@")[0] in shown for name, _ in groups)
    results = _results_of_study(folder) if has_shown else {}
    sides = study.plan.get("sides")
    outcomes = tuple(
        replace(_outcome(rows, sides), results=results.get(name, ()))
        for name, rows in groups.items()
        if rows[0]["dataset"]
    )
    data = {
        row["dataset"]: _number(row["score"], folder / "data.csv")
        for row in _read(folder / "data.csv", ("dataset", "score"))
        if row["score"]
    }
    title = str(study.plan.get("title") or Path(place).name)
    if study.chose_settings and "validation" not in title:
        title = f"{title}{VALIDATED}"
    charts = (*_curves(folder), *_sweeps(folder))
    return ResultSource(title, place, outcomes, data, charts)


def _results_of_study(folder: Path) -> dict[tuple[str, str], tuple[Result, ...]]:
    """The results in a study's archive by dataset and label; none if it has no archive."""
    archive = folder / ARCHIVE_FILE
    if not archive.is_file():
        return {}
    with tempfile.TemporaryDirectory() as place:
        found, _ = read_archive(Study.from_file(folder / PLAN_FILE), archive, Path(place))
    sets = [each for each in (found.results, found.sizes, found.views) if each is not None]
    return {
        (case.name, label): tuple(replace(run, path=None) for run in runs)  # it had no folder
        for each in sets
        for case in each.cases
        for label, runs in case.runs.items()
    }


def with_keys(sources: Sequence[ResultSource]) -> list[ResultSource]:
    """Names the pages of all outcomes whose episodes are known."""
    taken: set[str] = set()

    def named(source: ResultSource, outcome: Outcome) -> Outcome:
        words = f"result-{Path(source.place).name}-{outcome.label}-{outcome.dataset}"
        stem = key = re.sub(r"[^A-Za-z0-9_.-]+", "-", words)
        while outcome.results and key in taken:
            key = f"{stem}-{len(taken)}"
        taken.add(key)
        return replace(outcome, key=key) if outcome.results else outcome

    return [source.with_outcomes(named) for source in sources]


def _outcome(rows: Rows, sides: object) -> Outcome:
    """What rows of estimates say; `sides` are those of the study's plan, with their opponents."""
    first, ends = rows[0], ("mean", "low", "high")
    dataset = first["dataset"]
    opponents = sides.get(dataset.partition("@")[2]) if isinstance(sides, Mapping) else None
    if opponents is not None:
        dataset = f"{dataset}-vs-{opponents}"
    return Outcome(
        label=first["label"],
        family=FAMILY_OF.get(first["label"], family_name(first.get("family", ""))),
        dataset=dataset,
        estimates={
            row["quantity"]: Estimate(*(float(row[end] or math.nan) for end in ends))
            for row in rows
        },
        n_runs=int(first["seeds"]),
        updates=first["updates"],
        rewards=first["rewards"],
        runs=(),
    )


def _curves(folder: Path) -> list[LineSet]:
    """A chart of success for each dataset of a study that measured learning curves."""
    file = folder / "curves.csv"
    lines: dict[str, dict[str, dict[float, Estimate]]] = {}
    for row in _read(file, ("cell", "metric", "update", "mean", "low", "high")):
        if row["metric"] == "success":
            label, _, dataset = row["cell"].partition("/")
            update, *found = (_number(row[key], file) for key in ("update", "mean", "low", "high"))
            line = lines.setdefault(dataset, {}).setdefault(label, {})
            line[update] = Estimate(*(100 * value for value in found))
    y_name = "success (%), range over seeds"
    return [
        LineSet(f"Learning curves, {dataset}".removesuffix(", "), "updates", y_name, found)
        for dataset, found in lines.items()
    ]


def _sweeps(folder: Path) -> list[LineSet]:
    """A chart of the score for each sweep in a study's folder or below it."""
    charts = []
    for file in sorted(folder.rglob("sweep.csv")):
        lines: dict[str, dict[float, Estimate]] = {}
        names = ("part", "parameter", "value", "policy", "metric", "estimate", "low", "high")
        rows = _read(file, names)
        for row in rows:
            if row["metric"] == "score" and row["value"] and row["estimate"]:
                keys = ("value", "estimate", "low", "high")
                x, *found = (_number(row[key], file) for key in keys)
                lines.setdefault(row["policy"], {})[x] = Estimate(*found)
        if lines:
            ordered = {label: dict(sorted(line.items())) for label, line in lines.items()}
            what = f"{rows[0]['part']}: {rows[0]['parameter']}"
            charts.append(LineSet(f"Robustness, {what}", rows[0]["parameter"], "score", ordered))
    return charts


def _read(file: Path, names: Sequence[str]) -> Rows:
    """Rows of a CSV file; none where it is absent or empty."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    reader = csv.DictReader(io.StringIO(text))
    missing = [name for name in names if name not in (reader.fieldnames or ())]
    if missing and text.strip():
        raise SchemaError(
            f"{file} has no column {', '.join(missing)}, got {reader.fieldnames}. Expected a "
            "file that `swarmdata study` or `swarmdata sweep` wrote."
        )
    return list(reader)


def _number(text: str, file: Path) -> float:
    """A number of a CSV file; an empty one is undefined."""
    try:
        return float(text) if text else math.nan
    except ValueError as error:
        raise SchemaError(f"{file} has {text!r}, expected a number") from error
