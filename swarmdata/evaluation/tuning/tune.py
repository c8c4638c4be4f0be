"""Tunes an offline algorithm: the same random search for every one, chosen by two rules.

Trial 0 is the configuration as it is, the others change what is drawn from the algorithm's search
space (`learn.training.settings`). Each is trained as a cell of a study, with the same seeds and
updates, on the first episodes of each dataset. Rule A chooses by the mean score over validation
episodes, where the data have a simulator; rule B by the data alone: fitted Q evaluation, of which
the least of several fits is trusted, at the lower end of its interval (`policy_selection`).

Random search is that of Bergstra & Bengio, "Random Search for Hyper-Parameter Optimization", JMLR
2012; equal numbers of trials for every algorithm are what makes a comparison of them fair (Dodge et
al., "Show Your Work: Improved Reporting of Experimental Results", EMNLP 2019).
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from swarmdata import __version__
from swarmdata.errors import ResultsError, SpecError
from swarmdata.evaluation.results.result_set import group_results, reference_of
from swarmdata.evaluation.runs.portable_names import portable_name
from swarmdata.evaluation.study.cells.cells import Cell, offline_cell
from swarmdata.evaluation.study.cells.run_cells import run_cells
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import results_of
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.tuning.trial_estimates import (
    read_estimates,
    run_estimates,
    why_without,
    why_without_data,
)
from swarmdata.evaluation.tuning.tuning_record import CELLS, TUNING, Trial, Tuning
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.training.settings import drawn_settings, space_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.output_folder import check_output
from swarmdata.specs.plain_names import repeated

DEFAULT_UPDATES = 4_500
"""Of each trial; 0.7 epochs of a million joint steps with batches of 128, 3.6 of 200,000."""


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
        SpecError: a number is out of its range, or a setting has the wrong type.
        OutputError: `out` has files that no tuning wrote.
        StaleCellError: `out` has trainings of another configuration, and `again` is false.
        ResultsError: all trials failed, scores in several tasks have no common unit, or neither
            rule could choose.
        BatchError: estimates failed; the same call goes on.
    """
    require_extra("matplotlib", "plots", "drawing the curve of a tuning")
    work = Path(out)
    check_output(work, TUNING, besides=CELLS)
    drawn = _drawn(algorithm, n_trials, draws)
    study = _study(
        algorithm, drawn, changes or {}, updates=n_updates, frame=frame, device=device,
        datasets=[portable_name(each) for each in dataset_ids], seeds=n_seeds, episodes=n_episodes,
    )  # fmt: skip
    cells, unit = _cells(study, n_steps, progress=progress)
    options: dict[str, Any] = {"engine": engine, "workers": workers, "progress": progress}
    every = [cell for of_trial in cells for cell in of_trial]
    if not every[0].n_episodes:
        _try_first(cells[0], work, again=again, **options)
    failures = run_cells(every, work, again=again, **options)
    done = [cell for cell in every if cell.name not in failures]
    silent = why_without(done, work) if done else None
    if silent is None:
        run_estimates(done, work, **options)
    made = _tuning(drawn, cells, unit, work, failures, silent)
    made.write(work)
    return made


def _try_first(cells: Sequence[Cell], work: Path, **options: Any) -> None:
    """Trains the first trial on data without a simulator; raises where estimates cannot choose."""
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


def _drawn(algorithm: str, n_trials: int, seed: int) -> list[dict[str, Any]]:
    """What each trial changes, nothing in the first."""
    if n_trials < 2:
        raise SpecError(f"n_trials is {n_trials}, expected at least 2: one is the default")
    space = space_of(resolve("algorithm", OFFLINE_ALGORITHMS, algorithm), algorithm)
    return [{}, *islice(drawn_settings(space, seed), n_trials - 1)]


def _study(
    algorithm: str,
    drawn: Sequence[dict[str, Any]],
    changes: Mapping[str, Any],
    *,
    updates: int,
    frame: str,
    **plan: Any,
) -> Study:
    """The plan with a row for each trial."""
    if "n_updates" in changes:
        raise SpecError("changes has n_updates, which is the argument n_updates; leave it out")
    if twice := repeated(map(short_name, plan["datasets"])):
        raise SpecError(f"two datasets are called {', '.join(twice)}; rename a folder")
    row = {"algorithm": algorithm, "family": "trials", "updates": updates, "frame": frame}
    rows = {
        f"trial-{number:02}": {**row, "settings": {**changes, **settings}}
        for number, settings in enumerate(drawn)
    }
    return Study.parse({"name": "tuning", "block": "validation", "algorithms": rows, **plan})


def _cells(
    study: Study, n_steps: int | None, *, progress: bool
) -> tuple[list[list[Cell]], Literal["score", "return"]]:
    """The cells of each trial, one for each dataset, and what trials are compared by."""
    opened = {name: load(name, progress=progress) for name in study.datasets}
    without = [each.id for each in opened.values() if reference_of(each.spec) is None]
    if without and len(opened) > 1:
        raise ResultsError(
            f"{without[0]} has no measured references, so that its returns have no common unit "
            "with the scores of other datasets. Tune on it alone."
        )
    unit: Literal["score", "return"] = "return" if without else "score"
    digests = {name: each.digest for name, each in opened.items()}
    parts: dict[str, int | None] = dict.fromkeys(opened)
    for name, each in opened.items():
        if n_steps is not None and each.episodes.lengths[:-1].sum() >= n_steps:
            parts[name] = n_steps  # of fewer steps, all are kept
    cells = [
        [
            offline_cell(study, label, name, digests.__getitem__, n_steps=part)
            for name, part in parts.items()
        ]
        for label in study.algorithms
    ]
    if all(each.spec.world for each in opened.values()):
        return cells, unit
    unscored = {"n_episodes": 0}
    return [[cell.model_copy(update=unscored) for cell in trial] for trial in cells], unit


def _tuning(
    drawn: Sequence[dict[str, Any]],
    cells: Sequence[Sequence[Cell]],
    unit: Literal["score", "return"],
    work: Path,
    failures: Mapping[str, str],
    silent: str | None,
) -> Tuning:
    """The record of trials, given what each changes, its cells, and why there are no estimates."""
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
    """A trial with its scores and estimates."""
    failed = [failures[cell.name] for cell in cells if cell.name in failures]
    known = [] if failed else cells
    kind, config = resolve("algorithm", OFFLINE_ALGORITHMS, cells[0].algorithm), cells[0].config
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
