"""Tunes an offline algorithm: the same random search for every one, chosen by two rules."""

import dataclasses
import json
from collections import ChainMap
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np

from swarmdata import __version__
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ResultsError, SpecError, StaleCellError
from swarmdata.evaluation.policy_selection.rank import rank
from swarmdata.evaluation.policy_selection.ranking_record import Ranking
from swarmdata.evaluation.results.result_set import group_results, reference_of
from swarmdata.evaluation.runs.job_options import JobOptions, do_with_bar
from swarmdata.evaluation.runs.portable_names import portable_name
from swarmdata.evaluation.study.cells.cells import Cell, offline_cell
from swarmdata.evaluation.study.cells.run_cells import run_cells
from swarmdata.evaluation.study.cells.study_data import open_dataset, short_name
from swarmdata.evaluation.study.pages.collect_results import results_of
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.tuning.tuning_record import (
    CELLS,
    ESTIMATES,
    RECORD,
    TUNING,
    Trial,
    Tuning,
)
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.evaluation.fqe import FQEConfig
from swarmdata.learn.evaluation.transitions import Actor
from swarmdata.learn.training.run_folder import load_run
from swarmdata.learn.training.settings import (
    as_texts,
    check_effects,
    drawn_settings,
    override,
    space_of,
    unmet_needs,
)
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.runtime.engines.jobs import Handler, Job, Report
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.output_folder import check_output
from swarmdata.specs.plain_names import repeated
from swarmdata.store.split_rule import empty_validation

DEFAULT_UPDATES = 4_500  # of each trial: with batches of 128, 3.6 epochs of 200,000 joint steps

ESTIMATOR = f"{__name__}:estimator"

RANKING_FOLDER = "ranking"  # of a cell, beside its run and its results

LEFT_OUT = "they were left out (--no-estimates)."

FITS = FQEConfig(hidden=(64, 64), n_fits=3)  # as cheap as one; the least is trusted


def tune(
    algorithm: str,
    dataset_ids: Sequence[str | Path],
    out: Path | str,
    *,
    n_trials: int = 12,
    n_updates: int = DEFAULT_UPDATES,
    n_seeds: int = 2,
    n_steps: int | None = 200_000,
    n_episodes: int = 128,
    estimates: bool = True,
    changes: Mapping[str, Any] | None = None,
    draws: int = 0,
    frame: str = "auto",
    device: str = "cpu",
    workers: int = 1,
    engine: str | Executor = LOCAL,
    again: bool = False,
    progress: bool = True,
) -> Tuning:
    """Searches settings of an offline algorithm; the same call resumes, also with more trials.

    Trial 0 is the configuration as it is, the others change what is drawn from the algorithm's
    search space: the random search of Bergstra & Bengio, "Random Search for Hyper-Parameter
    Optimization", JMLR 2012. Rule A chooses by the mean score over validation episodes, where the
    data have a simulator; rule B by fitted Q evaluation on the data alone.

    Writes the settings that the rules chose, `validation.yaml` and `offline.yaml`, which `train
    --config` takes, `trials.csv`, the expected score over the number of trials (`curve.csv`,
    `curve.png`), and a page, `tuning.md`. Trainings are kept in `out/cells`.

    Args:
        algorithm: registered offline algorithm that declares a search space.
        dataset_ids: ids or folders of datasets; scores are means over them. A recording of another
            environment has no scores, and is tuned on alone.
        out: folder of the result.
        n_trials: configurations, the unchanged one included.
        n_updates: of each training.
        n_seeds: of each trial.
        n_steps: joint steps of each dataset, its first episodes; None: all.
        n_episodes: validation episodes of each seed.
        estimates: whether rule B chooses, too; its fits take about as long as the trainings, and
            the same call can add them later.
        changes: settings of all trials, such as `{"batch_size": 128}`, but no numbers of updates,
            which follow `n_updates`.
        draws: seed of the random settings.
        frame: of observations and actions, as `train` takes it.
        device: torch device.
        workers: processes of the engine `local`.
        engine: where trials run, as `train` takes it.
        again: whether trainings of another configuration in `out` are deleted and run again.
        progress: whether to show progress bars.

    Raises:
        UnknownNameError: no such algorithm, setting or dataset.
        SchemaError: the algorithm declares no search space.
        SpecError: a number is out of its range, a setting has the wrong type, or data without a
            simulator are to be tuned on without estimates.
        OutputError: `out` has files that no tuning wrote.
        StaleCellError: `out` has trainings of another configuration, or a tuning on other data, and
            `again` is false.
        ResultsError: all trials failed, scores in several tasks have no common unit, or neither
            rule could choose.
        BatchError: estimates failed; the same call goes on.
    """
    require_extra("matplotlib", "plots", "drawing the curve of a tuning")
    work = Path(out)
    check_output(work, TUNING, besides=CELLS)
    drawn = _drawn(algorithm, changes or {}, n_trials, draws)
    study = _study(
        algorithm, drawn, changes or {}, updates=n_updates, frame=frame, device=device,
        datasets=[portable_name(each) for each in dataset_ids], seeds=n_seeds, episodes=n_episodes,
    )  # fmt: skip
    cells, unit = _cells(study, n_steps, progress=progress)
    _check_data(cells[0], work, again=again)
    options: dict[str, Any] = {"engine": engine, "workers": workers, "progress": progress}
    every = [cell for of_trial in cells for cell in of_trial]
    _try_first(cells[0], work, estimates=estimates, again=again, **options)
    failures = run_cells(every, work, again=again, **options)
    done = [cell for cell in every if cell.name not in failures]
    silent = _estimate(done, work, **options) if estimates else LEFT_OUT
    made = _tuning(drawn, cells, unit, work, failures, silent)
    made.write(work)
    return made


def _check_data(cells: Sequence[Cell], work: Path, *, again: bool) -> None:
    """Refuses a tuning on other data, whose trainings have names of their own beside the first."""
    if again or not (work / RECORD).exists():
        return
    known = Tuning.from_file(work / RECORD).datasets
    if known != {cell.data: cell.digest for cell in cells}:
        names = (", ".join(each) for each in (known, (cell.data for cell in cells)))
        raise StaleCellError(
            "{} has a tuning on {}, not {}: another digest, number of joint steps or dataset. Pass "
            "--again to replace its tables, or name another folder.".format(work, *names)
        )


def _try_first(cells: Sequence[Cell], work: Path, *, estimates: bool, **options: Any) -> None:
    """Trains the first trial on data without a simulator; raises where estimates cannot choose."""
    if cells[0].n_episodes:
        return
    if not estimates:
        raise SpecError(
            f"{cells[0].source} has no simulator, so that only offline estimates can choose; leave "
            "out estimates=False (--no-estimates)"
        )
    why_not = why_without_data(cells)
    if why_not is None:
        run_cells(cells, work, **options)
        trained = [cell for cell in cells if cell.is_done(cell.folder(work))]
        why_not = why_without(trained, work) if trained else None
    if why_not is not None:
        raise ResultsError(
            "without a simulator, trials are chosen by offline estimates, and there are none: "
            + why_not
        )


def _estimate(trained: Sequence[Cell], work: Path, **options: Any) -> str | None:
    """Estimates the policies of trained cells; returns why that is impossible, else None."""
    why_not = why_without(trained, work) if trained else None
    if why_not is None:
        run_estimates(trained, work, **options)
    return why_not


def _drawn(
    algorithm: str, changes: Mapping[str, Any], n_trials: int, seed: int
) -> list[dict[str, Any]]:
    """The settings of each trial, without those that have no effect beside the others."""
    if n_trials < 2:
        raise SpecError(f"n_trials is {n_trials}, expected at least 2: one is the default")
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    trials: list[dict[str, Any]] = [{}]
    for settings in islice(drawn_settings(space_of(kind, algorithm), seed), n_trials - 1):
        kept = _with_effect(kind, {**changes, **settings})
        trials.append({name: value for name, value in settings.items() if name in kept})
    return trials


def _with_effect(kind: Any, settings: Mapping[str, Any]) -> dict[str, Any]:
    unmet = unmet_needs(override(kind.Config(), as_texts(settings)))
    return {name: value for name, value in settings.items() if name not in unmet}


def _study(
    algorithm: str,
    drawn: Sequence[dict[str, Any]],
    changes: Mapping[str, Any],
    *,
    updates: int,
    frame: str,
    **plan: Any,
) -> Study:
    if "n_updates" in changes:
        raise SpecError("changes has n_updates, which is the argument n_updates; leave it out")
    if twice := repeated(map(short_name, plan["datasets"])):
        raise SpecError(f"two datasets are called {', '.join(twice)}; rename a folder")
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    trials = [_with_effect(kind, {**changes, **settings}) for settings in drawn]
    check_effects(override(kind.Config(), as_texts(changes)), changes.keys() - ChainMap(*trials))
    row = {"algorithm": algorithm, "family": "trials", "updates": updates, "frame": frame}
    rows = {f"trial-{k:02}": {**row, "settings": each} for k, each in enumerate(trials)}
    return Study.parse({"name": "tuning", "block": "validation", "algorithms": rows, **plan})


def _cells(
    study: Study, n_steps: int | None, *, progress: bool
) -> tuple[list[list[Cell]], Literal["score", "return"]]:
    opened = {name: load(name, progress=progress) for name in study.datasets}
    without = [each.id for each in opened.values() if reference_of(each.spec) is None]
    if without and len(opened) > 1:
        raise ResultsError(
            f"{without[0]} has no measured references, so that its returns have no common unit "
            "with the scores of other datasets. Tune on it alone."
        )
    is_simulated = all(each.spec.world for each in opened.values())

    def cell(label: str, name: str, data: Dataset) -> Cell:
        is_cut = n_steps is not None and data.episodes.lengths[:-1].sum() >= n_steps
        part = n_steps if is_cut else None  # of fewer steps, all are kept
        made = offline_cell(study, label, name, lambda _: data.digest, n_steps=part)
        return made if is_simulated else made.model_copy(update={"n_episodes": 0})

    cells = [[cell(label, *each) for each in opened.items()] for label in study.algorithms]
    return cells, "return" if without else "score"


def _tuning(
    drawn: Sequence[dict[str, Any]],
    cells: Sequence[Sequence[Cell]],
    unit: Literal["score", "return"],
    work: Path,
    failures: Mapping[str, str],
    silent: str | None,
) -> Tuning:
    first = cells[0][0]
    return Tuning(
        code_version=__version__,
        algorithm=first.algorithm,
        datasets={cell.data: cell.digest for cell in cells[0]},
        n_updates=first.n_updates,
        seeds=first.seeds,
        n_episodes=first.n_episodes,
        unit=unit,
        without_estimates=silent,
        trials=tuple(
            _trial(settings, of_trial, work, failures, is_estimated=silent is None)
            for settings, of_trial in zip(drawn, cells, strict=True)
        ),
    )


def _trial(
    settings: dict[str, Any],
    cells: Sequence[Cell],
    work: Path,
    failures: Mapping[str, str],
    *,
    is_estimated: bool,
) -> Trial:
    failed = [failures[cell.name] for cell in cells if cell.name in failures]
    known, config = [] if failed else cells, cells[0].config
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, cells[0].algorithm)
    defaults = json.loads(json.dumps(dataclasses.asdict(kind.Config())))
    return Trial(
        settings=settings,
        config={name: value for name, value in config.items() if value != defaults[name]},
        scores={cell.data: _score(cell, work) for cell in known if cell.n_episodes},
        estimates={cell.data: read_estimates(cell, work) for cell in known if is_estimated},
        failure=failed[0] if failed else None,
    )


def _score(cell: Cell, work: Path) -> float:
    # the cell's key has been compared: a folder may hold other data under a published name
    (case,) = group_results(results_of([cell], work), is_checked=False).cases
    is_scored = case.reference is not None
    values = case.scores(cell.label) if is_scored else case.metric(cell.label, "return")
    return float(values.mean())


def why_without(cells: Sequence[Cell], work: Path) -> str | None:
    """Why policies of trained cells cannot be estimated from their data; None where they can."""
    policies = load_run(cells[0].run_in(cells[0].folder(work)))
    if not isinstance(policies[0], Actor):
        return (
            f"the policies of {cells[0].algorithm} draw their actions or remember, so that what "
            "they would have done in recorded states is not known."
        )
    return why_without_data(cells)


def why_without_data(cells: Sequence[Cell]) -> str | None:
    """Why no policy can be estimated from the cells' data; None where that is possible."""
    for source, n_steps in {(cell.source, cell.n_steps) for cell in cells}:
        dataset = open_dataset(source, n_steps)
        if not len(dataset.split("validation")):
            return f"{dataset.id}: {empty_validation(len(dataset))}"
    return None


def run_estimates(cells: Sequence[Cell], work: Path, **options: Unpack[JobOptions]) -> None:
    """Ranks the policies of trained cells without a ranking; raises BatchError if some fail."""
    jobs = [
        Job(f"estimates of {cell.name}", {"folder": str(cell.folder(work).resolve())})
        for cell in cells
        if not _ranking_file(cell, work).exists()
    ]
    do_with_bar(jobs, ESTIMATOR, "estimates", work, total=len(jobs), **options)


def read_estimates(cell: Cell, work: Path) -> dict[str, float]:
    """The criteria of a cell's policies, means over seeds, by name."""
    policies = Ranking.from_file(_ranking_file(cell, work)).policies
    return {
        name: float(np.mean([getattr(policy, name) for policy in policies])) for name in ESTIMATES
    }


def _ranking_file(cell: Cell, work: Path) -> Path:
    return cell.folder(work) / RANKING_FOLDER / "ranking.json"


def estimator() -> Handler:
    """Returns what ranks the policies of one cell in a process."""

    def handle(payload: dict[str, Any], report: Report) -> None:
        folder = Path(payload["folder"])
        cell = Cell.in_folder(folder)
        dataset = open_dataset(cell.source, cell.n_steps)
        made = rank(
            [cell.run_in(folder)], dataset_id=str(dataset.path), config=FITS, device=cell.device,
            progress=False,
        )  # fmt: skip
        made.write(folder / RANKING_FOLDER)
        report(1)

    return handle
