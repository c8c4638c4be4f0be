"""Does one cell in a process of its own: trains, evaluates, keeps the policies, writes the cost.

A cell's folder:

    cell.json   what it is, written first; a folder of another cell is refused
    data.json   facts of its dataset
    LABEL/      the run (`learn.trainer`), called like the algorithm's label; once trained, only
                with its policies
    results/    one file per seed
    cost.json   time, memory, speed
    error.txt   why it failed, if it did
    done.json   written last: the key, and the digests of the results
"""

import hashlib
import json
import shutil
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError
from swarmdata.evaluation.results.policy_names import Target, evaluate_target, find_target
from swarmdata.evaluation.runs.provenance import file_name
from swarmdata.evaluation.runs.run_files import CONFIG, run_folders
from swarmdata.evaluation.runs.train import frame_of
from swarmdata.evaluation.study.cells.cell_costs import Meter
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import Facts, open_data
from swarmdata.interfaces import Policy
from swarmdata.learn.training.compact import compact
from swarmdata.learn.training.overrides import from_json
from swarmdata.learn.training.run_folder import CHECKPOINT
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.online_algos.runs.checkpoint_selection import seeds_of
from swarmdata.online_algos.runs.online_training import describe_run, train_run
from swarmdata.online_algos.runs.seed_files import POLICIES, last_policy_path, saved_frames
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.runtime.locking import locked
from swarmdata.runtime.workers import Report, serve
from swarmdata.specs.frozen import differences
from swarmdata.specs.origins import Edit
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import write_file

CELL, DATA, RESULTS, COST, ERROR, DONE = (
    "cell.json", "data.json", "results", "cost.json", "error.txt", "done.json",
)  # fmt: skip

CURVE_METRICS = ("return", "success", "clean_success")
"""What a learning curve holds, as means over its episodes."""


def is_done(cell: Cell, folder: Path) -> bool:
    """Whether the folder holds this cell's results, complete."""
    file = folder / DONE
    return file.exists() and json.loads(file.read_text(encoding="utf-8"))["key"] == cell.key


def read_cell(folder: Path) -> Cell:
    """The cell that a folder belongs to."""
    return Cell.from_file(folder / CELL)


def claimed_by_other(cell: Cell, folder: Path) -> str | None:
    """In which fields the folder's cell differs, None if it is this one's or nobody's."""
    if not (folder / CELL).exists():
        return None
    there = read_cell(folder)
    if there.key == cell.key:
        return None
    pairs = list(differences(there, cell))
    return "; ".join(f"{path} was {old!r}, is {new!r}" for path, old, new in pairs[:3])


def do_cell(cell: Cell, folder: Path, report: Report = lambda amount: None) -> None:
    """Does what is missing of a cell; killed at any moment, the next call goes on.

    Args:
        cell: what to do.
        folder: the cell's; made if absent.
        report: is told how many updates were made since its last call.

    Raises:
        BuildError: the folder is of another cell.
        SwarmdataError: training or evaluation refused.
    """
    with locked(folder):
        if is_done(cell, folder):
            return
        if other := claimed_by_other(cell, folder):
            raise BuildError(f"{folder} holds another {cell.name}: {other}")
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / CELL, cell.to_json().encode())
        (folder / ERROR).unlink(missing_ok=True)
        meter = Meter(folder / COST)

        def beat(updates: int) -> None:
            meter.beat(updates)
            report(updates)

        run = run_of(cell, folder)
        with meter.stage("train"):
            _TRAIN[cell.kind](cell, run, meter, beat)
        with meter.stage("evaluate"):
            files = _evaluate(cell, run, folder / RESULTS, beat)
        meter.write()
        digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
        done = {"key": cell.key, "results": digests}
        write_file(folder / DONE, json.dumps(done, indent=1).encode())


def run_of(cell: Cell, folder: Path) -> Path:
    """The run folder of a cell, whose name is its policies' label."""
    return folder / cell.label


def _train_offline(cell: Cell, run: Path, meter: Meter, report: Report) -> None:
    models = {"observation": cell.observation, "communication": cell.communication}
    dataset = open_data(cell.source, cell.n_steps, **models)
    _check_digest(cell, dataset)
    spec = dataset.task
    write_file(run.parent / DATA, Facts.of(dataset).to_json().encode())

    def measure(policy: Policy) -> dict[str, float]:
        with meter.stage("curve"):
            return _measure(policy, spec, cell.curve_episodes)

    train_seeds(
        cell.algorithm,
        dataset.split("train"),
        run,
        seeds=cell.seeds,
        config=_config(OFFLINE_ALGORITHMS, cell),
        schedule=schedule_of(cell),
        evaluate=None if cell.curve_every is None else measure,
        frame=frame_of(dataset.spec, cell.frame),
        device=cell.device,
        progress=False,
        report=report,
    )
    compact(run)


def _check_digest(cell: Cell, dataset: Dataset) -> None:
    recipe = dataset.recipe
    is_part = cell.n_steps is not None and isinstance(recipe, Edit)
    digest = recipe.parents[0].digest if is_part else dataset.digest  # type: ignore[union-attr]
    if digest != cell.digest:
        raise SchemaError(
            f"{cell.source} has digest {digest[:12]}, the study expects {cell.digest[:12]}: it was "
            "rebuilt with other bits, or changed meanwhile. Fetch the published one."
        )


def schedule_of(cell: Cell) -> Schedule:
    """At least 50 rows of losses, and checkpoints every ten of them."""
    every = max(1, min(100, cell.n_updates // 50))
    return Schedule(every, 10 * every, cell.curve_every)


def _config(table: Any, cell: Cell) -> Any:
    return from_json(resolve("algorithm", table, cell.algorithm).Config, cell.config)


def _train_online(cell: Cell, run: Path, meter: Meter, report: Report) -> None:
    """Trains in the task, and keeps the last policies."""
    last = (saved_frames(run, seed)[-1:] for seed in cell.seeds)
    is_finished = all(frames and frames[0] >= cell.n_updates for frames in last)
    if not is_finished or (run / CHECKPOINT).exists():
        config = _config(ONLINE_ALGORITHMS, cell)
        description = describe_run(cell.algorithm, config, find_spec(cell.source), cell.seeds)
        train_run(description, run, progress=False)
        meter.beat(cell.n_updates)
        report(cell.n_updates)
    for name in (CHECKPOINT, "replay", "tensorboard"):
        path = run / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    for policies in (run / POLICIES).glob("seed-*"):
        for file in sorted(policies.glob("*.safetensors"))[:-1]:
            file.unlink()


def _copy_run(cell: Cell, run: Path, meter: Meter, report: Report) -> None:
    """Copies what a finished online run needs to act, so that the study stands on its own."""
    source = Path(cell.run)
    for part in run_folders(source):
        there = run / part.relative_to(source)
        for seed in seeds_of([part]):
            policy = last_policy_path(*seed)
            (there / policy.relative_to(part)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(policy, there / policy.relative_to(part))
        shutil.copyfile(part / CONFIG, there / CONFIG)


_TRAIN = {"offline": _train_offline, "online": _train_online, "run": _copy_run}


def _measure(policy: Policy, spec: TaskSpec, n_episodes: int) -> dict[str, float]:
    result = evaluate(policy, spec, name="curve", n_episodes=n_episodes, progress=False)
    return {name: float(np.mean(result.metrics[name])) for name in CURVE_METRICS}


def _evaluate(cell: Cell, run: Path, out: Path, report: Report) -> list[Path]:
    """Evaluates the last policy of each seed on reserved seeds; keeps what is there already."""
    target = find_target(str(run)).labelled(cell.label)
    seeds = tuple(each.seed for each in target.provenances)
    if seeds != cell.seeds:
        raise SchemaError(f"{run} has policies of the seeds {seeds}, expected {cell.seeds}")
    for policy, provenance in zip(target.policies, target.provenances, strict=True):
        one = Target(target.spec, (policy,), (provenance,))
        evaluate_target(one, cell.n_episodes, out, progress=False)
        report(0)  # fails where nobody waits for this process any more
    names = (file_name(each, target.spec.hash()) for each in target.provenances)
    return [out / name for name in names]


def _handle(payload: dict[str, Any], report: Report) -> None:
    """One job of a worker: a failure is written beside the cell, and told in one line."""
    cell, folder = Cell.parse(payload["cell"]), Path(payload["folder"])
    try:
        do_cell(cell, folder, report)
    except BrokenPipeError:
        raise  # whoever started this is gone
    except Exception as error:  # a bug in an algorithm must not stop the other cells
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / ERROR, traceback.format_exc().encode())
        raise BuildError(f"{type(error).__name__}: {error}") from error


def work() -> None:
    """The main loop of a worker process."""
    serve(_handle)
