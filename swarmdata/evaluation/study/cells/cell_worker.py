"""Runs one cell in its own process: trains, evaluates, keeps the policies, records the cost."""

import hashlib
import json
import shutil
import traceback
from pathlib import Path
from typing import Any

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture
from swarmdata.errors import BuildError, SchemaError
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.named_policies import find_opponents
from swarmdata.evaluation.runs.provenance import file_name
from swarmdata.evaluation.runs.train import measure_curve_point
from swarmdata.evaluation.study.cells.cell_costs import CostMeter
from swarmdata.evaluation.study.cells.cells import (
    CELL_FILE,
    COST_FILE,
    DATA_FILE,
    DONE_FILE,
    ERROR_FILE,
    RESULTS_FOLDER,
    Cell,
)
from swarmdata.evaluation.study.cells.study_data import (
    DatasetFacts,
    joint_digest,
    open_dataset,
    open_mixture,
)
from swarmdata.interfaces import Policy
from swarmdata.learn.training.compact import compact
from swarmdata.learn.training.run_files import (
    CHECKPOINT,
    CONFIG,
    REPLAY_FOLDER,
    last_policy_path,
    run_folders,
    saved_frames,
    saved_policies,
    seeds_of,
)
from swarmdata.learn.training.settings import from_json
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.online_algos.continuation.offline_start import read_start
from swarmdata.online_algos.runs.online_training import describe_run, train_run
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.runtime.engines.jobs import Handler, Report
from swarmdata.runtime.locking import locked
from swarmdata.specs.model_choice import with_models
from swarmdata.store import write_file

MIN_LOSS_ROWS = 50  # rows of losses that even a short run has, for its figure

MAX_LOG_INTERVAL = 100  # updates between two rows of losses, at most


def run_cell(cell: Cell, folder: Path, report: Report = lambda amount: None) -> None:
    """Runs a cell that is not done yet; after a kill at any moment, the next call resumes.

    `report` gets the number of updates since its last call.

    Raises:
        SwarmdataError: training or evaluation failed.
    """
    with locked(folder):
        if cell.is_done(folder):
            return
        if other := cell.conflict(folder):
            raise BuildError(f"{folder} holds another {cell.name}: {other}")
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / CELL_FILE, cell.to_json().encode())
        (folder / ERROR_FILE).unlink(missing_ok=True)
        meter = CostMeter(folder / COST_FILE)

        def count(updates: int) -> None:
            meter.add_updates(updates)
            report(updates)

        run = cell.run_in(folder)
        with meter.stage("train"):
            _TRAIN[cell.kind](cell, run, meter, count)
        with meter.stage("evaluate"):
            files = _evaluate(cell, run, folder / RESULTS_FOLDER, count)
        meter.write()
        digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
        done = {"key": cell.key, "results": digests}
        write_file(folder / DONE_FILE, json.dumps(done, indent=1).encode())


def _open(cell: Cell) -> tuple[Dataset | Mixture, Dataset | Mixture, str]:
    """The dataset, the same with the rewards to learn from, and its digest as cells have it."""
    models = {"observation": cell.observation, "communication": cell.communication}
    if cell.parts:
        mixture = open_mixture(cell.parts, **models)
        parts = (part.digest for part in mixture.parts)
        return mixture, mixture, joint_digest(parts, cell.parts.values())
    dataset = open_dataset(cell.source, cell.n_steps, **models)
    learned, parents = dataset.with_rewards(**cell.rewards), dataset.recipe.parents
    digest = parents[0].digest if cell.n_steps is not None and parents else dataset.digest
    if cell.side is None or cell.opponents is None:
        return dataset, learned, digest
    find_opponents(cell.opponents, cell.side, dataset.task)  # raises now, not after the training
    return dataset.side(cell.side), learned.side(cell.side), digest


def _train_offline(cell: Cell, run: Path, meter: CostMeter, report: Report) -> None:
    """Trains on the dataset, and keeps only what the policies need."""
    dataset, learned, digest = _open(cell)
    if digest != cell.digest:
        raise SchemaError(
            f"{cell.source} has digest {digest[:12]}, the study expects {cell.digest[:12]}: it was "
            "rebuilt with different bits, or has changed since. Fetch the published dataset."
        )
    if cell.n_episodes:
        _ = dataset.task  # raises now, not after the training, where there is no simulator
    write_file(run.parent / DATA_FILE, DatasetFacts.of(dataset).to_json().encode())

    def measure(policy: Policy) -> dict[str, float]:
        with meter.stage("curve"):
            return measure_curve_point(policy, dataset.task, cell.curve_episodes)

    log_every = max(1, min(MAX_LOG_INTERVAL, cell.n_updates // MIN_LOSS_ROWS))
    train_seeds(
        cell.algorithm,
        learned.split("train"),
        run,
        seeds=cell.seeds,
        config=_config(OFFLINE_ALGORITHMS, cell),
        schedule=Schedule(log_every, 10 * log_every, cell.curve_every),
        evaluate=None if cell.curve_every is None else measure,
        frame=frame_of(dataset.spec, cell.frame),
        device=cell.device,
        progress=False,
        report=report,
    )
    compact(run)


def _config(table: Any, cell: Cell) -> Any:
    return from_json(resolve("algorithm", table, cell.algorithm).Config, cell.config)


def _train_online(cell: Cell, run: Path, meter: CostMeter, report: Report) -> None:
    """Trains in the task, and keeps only the last policy of each seed."""
    last = (saved_frames(run, seed)[-1:] for seed in cell.seeds)
    is_finished = all(frames and frames[0] >= cell.n_updates for frames in last)
    if not is_finished or (run / CHECKPOINT).exists():
        config = _config(ONLINE_ALGORITHMS, cell)
        own = find_spec(cell.source)
        spec = with_models(own, cell.observation, cell.communication)
        start = read_start(cell.start) if cell.start else None
        description = describe_run(cell.algorithm, config, spec, cell.seeds, own=own, start=start)
        train_run(description, run, progress=False)
        meter.add_updates(cell.n_updates)
        report(cell.n_updates)
    for name in (CHECKPOINT, REPLAY_FOLDER, "tensorboard"):
        path = run / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    for seed in cell.seeds:
        for file in saved_policies(run, seed)[:-1]:
            file.unlink()


def _copy_run(cell: Cell, run: Path, meter: CostMeter, report: Report) -> None:
    """Copies the newest policies of a finished online run, so that the study is self-contained."""
    source = Path(cell.run)
    for part in run_folders(source):
        for file in (*(last_policy_path(*seed) for seed in seeds_of([part])), part / CONFIG):
            copy = run / file.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


_TRAIN = {"offline": _train_offline, "online": _train_online, "run": _copy_run}


def _evaluate(cell: Cell, run: Path, out: Path, report: Report) -> list[Path]:
    """Evaluates the last policy of each seed on the cell's seeds; existing results are kept."""
    if not cell.n_episodes:
        return []
    target = find_target(str(run), opponents=cell.opponents).labelled(cell.label)
    seeds = tuple(each.seed for each in target.provenances)
    if seeds != cell.seeds:
        raise SchemaError(f"{run} has policies of the seeds {seeds}, expected {cell.seeds}")
    for policy, provenance in zip(target.policies, target.provenances, strict=True):
        one = Target(target.spec, (policy,), (provenance,), target.side)
        evaluate_target(one, cell.n_episodes, out, block=cell.block, progress=False)
        report(0)  # fails if the process that started this one has ended
    names = (file_name(each, target.measured.hash()) for each in target.provenances)
    return [out / name for name in names]


def run_job(payload: dict[str, Any], report: Report) -> None:
    """Runs one job; a failure is one line for the caller, and a traceback in the cell's folder."""
    cell, folder = Cell.parse(payload["cell"]), Path(payload["folder"])
    try:
        run_cell(cell, folder, report)
    except BrokenPipeError:
        raise  # the process that started this one has ended
    except Exception as error:  # a bug in an algorithm must not stop the other cells
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / ERROR_FILE, traceback.format_exc().encode())
        raise BuildError(f"{type(error).__name__}: {error}") from error


def cell_runner() -> Handler:
    """Returns what runs cells in a worker process."""
    return run_job
