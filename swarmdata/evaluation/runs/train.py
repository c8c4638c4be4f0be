"""Trains an algorithm on a dataset of the catalog or in a task, as the command line does."""

import multiprocessing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture
from swarmdata.errors import BuildError, SchemaError, SpecError, UnknownNameError
from swarmdata.hub.catalog.catalog import load
from swarmdata.interfaces import Policy
from swarmdata.learn.training.overrides import as_texts, override
from swarmdata.learn.training.setup import check_device
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.online_algos.collection.recorded_rows import RecordedSource, check_spec
from swarmdata.online_algos.continuation.offline_start import check_task, read_start
from swarmdata.online_algos.runs.online_training import OnlineRun, describe_run, train_run
from swarmdata.perception.frames import Frame, find_frame, natural_anchor
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, make_task, resolve
from swarmdata.registry.presets import find_spec
from swarmdata.registry.replaced_worlds import check_world, is_simulated
from swarmdata.registry.reward_weights import RewardChoice
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.runtime.documents import read_document
from swarmdata.specs.model_choice import Source, with_models
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec

CURVE_EPISODES = 64
"""Validation episodes of each point of a learning curve."""

CURVE_METRICS = ("return", "success", "clean_success")
"""Columns of a learning curve, as means over the episodes of each evaluation."""


def train(
    algorithm: str,
    dataset_id: str | Sequence[str],
    out: Path,
    *,
    weights: Sequence[float] | None = None,
    n_seeds: int = 3,
    changes: Mapping[str, str] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    rewards: RewardChoice | None = None,
    frame: str = "auto",
    curve_every: int = 1000,
    keep: bool = False,
    device: str = "cpu",
    compile: bool = False,
    progress: bool = True,
) -> list[Policy]:
    """Trains seeds 0, 1, ... together on the train split; resumes an interrupted run in `out`.

    Args:
        algorithm: registered offline algorithm.
        dataset_id: id or folder of a dataset, as `load` takes it, or several to mix. On recordings
            of other environments there is no learning curve; evaluate with
            `swarmdata.evaluate_parallel` afterwards. On data of an older version of the world there
            is none either, since that world is not simulated.
        out: run folder.
        weights: of several datasets, as `load` takes them.
        n_seeds: number of seeds.
        changes: settings of the algorithm as text.
        observation: observation model for training and evaluation; None: as recorded.
        communication: communication model, likewise.
        rewards: weights of rewards to learn from, as `load` takes them; learning curves and
            evaluations stay on those of the task.
        frame: anchor of the frame of observations and actions, as `frames.find_frame` takes it, or
            `auto` for the natural one of the task.
        curve_every: updates between two points of the learning curve.
        keep: whether to keep all checkpoints, so that `rank` can compare them.
        device: torch device.
        compile: whether to compile the updates, as `train_seeds` takes it.
        progress: whether to show progress bars.

    Raises:
        UnknownNameError: no such algorithm, dataset or setting.
        SpecError: the task has no such frame.
        ProgramError: `compile` found no working compiler.
        CheckpointError: `out` holds another run.
    """
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    check_device(device)
    config = override(kind.Config(), changes or {})
    view: dict[str, Any] = {"observation": observation, "communication": communication}
    dataset = open_data(dataset_id, weights, view | {"rewards": rewards, "progress": progress})
    spec, evaluation = dataset.spec, None
    if spec.world is not None and is_simulated(spec.world):
        evaluation = partial(measure_curve_point, spec=spec.world)
    return train_seeds(
        algorithm,
        dataset.split("train"),
        out,
        seeds=tuple(range(n_seeds)),
        config=config,
        schedule=Schedule(evaluate_every=None if evaluation is None else curve_every),
        evaluate=evaluation,
        frame=frame_of(spec, frame),
        device=device,
        keep=keep,
        compile=compile,
        progress=progress,
    )


def open_data(
    dataset_id: str | Sequence[str], weights: Sequence[float] | None, view: Mapping[str, Any]
) -> Dataset | Mixture:
    """Opens one dataset, or several as a mixture.

    Args:
        dataset_id: id or folder; several are mixed.
        weights: of several.
        view: further arguments of `load`.
    """
    if isinstance(dataset_id, str) and weights is None:
        return load(dataset_id, **view)
    several = (dataset_id,) if isinstance(dataset_id, str) else tuple(dataset_id)
    return load(several, weights=weights, **view)


def frame_of(spec: Spec, anchor: str = "auto") -> Frame | None:
    """Returns the frame of an anchor in a task; None for the world frame.

    Args:
        spec: of a dataset. Recorded environments have only the world frame.
        anchor: as `frames.find_frame` takes it, or `auto` for the natural one of the task.

    Raises:
        SpecError: the task's observations have no such anchor.
    """
    if spec.world is None:
        if anchor not in ("auto", "world"):
            raise SpecError(
                f"frame {anchor!r}: the meaning of a recorded environment's features is unknown. "
                "Use frame 'world'."
            )
        return None
    features = features_of(make_task(spec.world))
    return find_frame(features, natural_anchor(features) if anchor == "auto" else anchor)


def train_online(
    algorithm: str,
    task: str,
    out: Path,
    *,
    seeds: Sequence[int] = (0, 1, 2, 3),
    changes: Mapping[str, str] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    start: Path | str | None = None,
    data: str | Sequence[str] | None = None,
    weights: Sequence[float] | None = None,
    offline_share: float = 0.5,
    workers: int = 1,
    progress: bool = True,
) -> None:
    """Trains seeds together in `out`; several processes train in folders `out/seeds-...`.

    Args:
        algorithm: registered online algorithm.
        task: to train in: a preset's name, or a spec file.
        out: run folder; an interrupted run in it resumes.
        seeds: of the policies.
        changes: settings of the algorithm as text.
        observation: observation model; None: that of the task.
        communication: communication model, likewise.
        start: folder of an offline run for the task, to begin with: its policies, the frame and
            statistics of their inputs, the sizes of its networks, and critics that fit. Settings
            that are changed win.
        data: id or folder of a dataset of the task, as `load` takes it, whose train split is mixed
            into the batches of algorithms with a replay; or several datasets.
        weights: of several datasets, as `load` takes them.
        offline_share: part of each batch that `data` give, above 0 and below 1.
        workers: number of processes, each with an equal share of the seeds.
        progress: whether to show progress bars.

    Raises:
        UnknownNameError: no such algorithm, task, dataset or setting.
        BuildError: a folder holds another run.
        CheckpointError: `start` is no offline run for this task, or has other seeds or policies
            than the algorithm can take.
        SchemaError: the algorithm has no replay, or `data` are of another task.
        SpecError: the task is of an older version of the world, or the share is out of its range.
    """
    kind = resolve("algorithm", ONLINE_ALGORITHMS, algorithm)
    spec = with_models(find_spec(task), observation, communication)
    check_world(spec)  # here, and not once in each process
    begin, settings = None, {}
    if start is not None:
        begin = read_start(start)
        check_task(begin, spec)
        settings = kind.settings_of(begin, features_of(make_task(spec)))
    config = override(kind.Config(), {**settings, **(changes or {})})
    view = {"observation": observation, "communication": communication, "progress": progress}
    mixed = None if data is None else Mixed(data, weights, view)
    recorded = None if mixed is None else _checked(mixed, algorithm, spec, offline_share)
    describe = partial(describe_run, algorithm, config, spec, start=begin, recorded=recorded)
    if workers == 1:
        train_run_with(describe(seeds), out, mixed, progress=progress)
        return
    groups = [tuple(map(int, group)) for group in np.array_split(seeds, workers) if len(group)]
    _train_in_processes([describe(group) for group in groups], out, mixed, progress=progress)


def _train_in_processes(
    runs: Sequence[OnlineRun], out: Path, mixed: "Mixed | None", *, progress: bool
) -> None:
    """Trains each run in a process and a folder of its own.

    Raises:
        BuildError: one of them failed.
    """
    context = multiprocessing.get_context("spawn")  # torch threads do not survive a fork
    jobs = []
    for run in runs:
        folder = out / f"seeds-{'-'.join(map(str, run.seeds))}"
        options = {"progress": progress and run is runs[0]}
        jobs.append(
            context.Process(target=train_run_with, args=(run, folder, mixed), kwargs=options)
        )
        jobs[-1].start()
    for job in jobs:
        job.join()
    if any(job.exitcode for job in jobs):
        raise BuildError(
            f"{sum(bool(job.exitcode) for job in jobs)} of {len(jobs)} processes failed; their "
            "errors are above. Run the same command again to resume from the last checkpoints."
        )


def _checked(mixed: "Mixed", algorithm: str, spec: TaskSpec, share: float) -> RecordedSource:
    """Describes data that an algorithm can mix in.

    Raises:
        SchemaError: it has no replay, or the data are of another task.
        SpecError: the share is out of its range.
    """
    if not hasattr(resolve("algorithm", ONLINE_ALGORITHMS, algorithm), "mix_in"):
        raise SchemaError(
            f"{algorithm} learns from the steps of its present policies only, so that recorded "
            "data cannot be mixed in. Leave out the data, or use maddpg, vdn or qmix."
        )
    episodes = mixed.load()
    check_spec(episodes, spec)
    return RecordedSource.of(episodes, share)


@dataclass(frozen=True, slots=True)
class Mixed:
    """Data that online training mixes in, which each process loads for itself."""

    dataset_id: str | Sequence[str]
    weights: Sequence[float] | None
    view: Mapping[str, Any]  # arguments of `load`

    def load(self) -> Dataset | Mixture:
        """Opens the train split."""
        return open_data(self.dataset_id, self.weights, self.view).split("train")


def train_run_with(run: OnlineRun, folder: Path, mixed: Mixed | None, *, progress: bool) -> None:
    """Trains a run in this process, which opens the data for itself."""
    train_run(run, folder, data=None if mixed is None else mixed.load(), progress=progress)


def read_settings(name: str) -> dict[str, str]:
    """Reads settings of an algorithm as text, like those of `--set`.

    Args:
        name: of a file in the package's `online_algos/configs`, without `.yaml`, or a path.

    Raises:
        UnknownNameError: there is no such file.
        SpecError: the file is not a table.
    """
    folder = files("swarmdata.online_algos") / "configs"
    shipped = {Path(file.name).stem: file for file in folder.iterdir()}
    file = Path(name) if Path(name).suffix else shipped.get(name)
    if file is None or not file.is_file():
        raise UnknownNameError("settings", name, shipped)
    try:
        table = read_document(Path(str(file)))
    except OSError as error:
        raise SpecError(f"cannot read settings from {name}: {error}") from error
    if not isinstance(table, dict):
        raise SpecError(f"{name} holds {type(table).__name__}, expected a table of settings")
    return as_texts(table)


def measure_curve_point(
    policy: Policy, spec: TaskSpec, n_episodes: int = CURVE_EPISODES
) -> dict[str, float]:
    """Evaluates a policy for one point of its learning curve: means of `CURVE_METRICS`."""
    result = evaluate(
        policy, spec, name="curve", n_episodes=n_episodes, block="validation", progress=False
    )
    return {name: float(np.mean(result.metrics[name])) for name in CURVE_METRICS}
