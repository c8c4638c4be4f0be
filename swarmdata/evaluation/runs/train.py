"""Trains an algorithm on a dataset of the catalog or in a task, as the command line does."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture
from swarmdata.errors import SchemaError, SpecError, UnknownNameError, list_of
from swarmdata.evaluation.runs.algorithm_choice import AUTO, choose_for
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.runs.named_policies import find_opponents
from swarmdata.evaluation.runs.portable_names import portable_name, portable_source
from swarmdata.evaluation.runs.seed_jobs import Group, train_in_groups
from swarmdata.evaluation.runs.trained_policies import read_trained
from swarmdata.hub.catalog.catalog import OPEN_AGAIN, load
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import CURVE, CURVE_METRICS, read_table, run_folders
from swarmdata.learn.training.settings import as_texts, check_effects, override
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.online_algos.collection.recorded_rows import RecordedSource, check_spec
from swarmdata.online_algos.continuation.offline_start import begin_with
from swarmdata.online_algos.runs.online_training import OnlineRun, describe_run, measure, train_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, make_task, resolve
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.engines.jobs import Handler, Report
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.model_choice import Ranges, Source, chosen_models, ranges_of
from swarmdata.specs.origins import SideSpec, check_installed
from swarmdata.specs.randomization import Randomization
from swarmdata.specs.rules import RewardChoice
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import check_device

CURVE_EPISODES = 64  # validation episodes of each point of a learning curve
DEFAULT_SEEDS = 5  # seeds of a training on data, as many as the leaderboard asks for
DEFAULT_ONLINE_SEEDS = 4  # seeds of a training in a task

Model = str | dict[str, Any] | None  # a model of `Source`, as JSON


class OfflineTraining(Frozen):
    """A training on datasets, as JSON: all but its seeds and its folder. See `train`."""

    algorithm: str
    dataset_id: str | list[str]
    weights: list[float] | None
    changes: dict[str, str]
    observation: Model
    communication: Model
    rewards: dict[str, float | str] | str | None
    side: str | None
    frame: str
    curve_every: int
    keep: bool
    device: str
    compile: bool

    def config(self) -> Any:
        """The algorithm's settings; raises where there are no such settings or device."""
        kind = resolve("algorithm", OFFLINE_ALGORITHMS, self.algorithm)
        check_device(self.device)
        config = override(kind.Config(), self.changes)
        check_effects(config, self.changes)
        return config

    def data(self, *, progress: bool) -> Dataset | Mixture:
        """Opens what is trained on, as it is seen and rewarded."""
        view = self.model_dump(include={"observation", "communication", "rewards", "side"})
        return open_data(self.dataset_id, self.weights, {**view, "progress": progress})

    def length(self, seeds: Group, *, progress: bool) -> int:
        """Updates of a run of some seeds; raises as `config` does."""
        return int(self.config().n_updates)

    def run(
        self, seeds: Group, folder: Path, *, progress: bool, report: Report | None = None
    ) -> list[Policy]:
        """Trains seeds together in a folder."""
        config, dataset = self.config(), self.data(progress=progress)
        spec, evaluation = dataset.spec, None
        if spec.world is not None:
            evaluation = partial(measure_curve_point, spec=spec.world)
        return train_seeds(
            self.algorithm,
            dataset.split("train"),
            folder,
            seeds=seeds,
            config=config,
            schedule=Schedule(evaluate_every=None if evaluation is None else self.curve_every),
            evaluate=evaluation,
            frame=frame_of(spec, self.frame),
            device=self.device,
            keep=self.keep,
            compile=self.compile,
            progress=progress,
            report=report,
        )


class OnlineTraining(Frozen):
    """A training in a task, as JSON: all but its seeds and its folder. See `train_online`."""

    algorithm: str
    task: str | dict[str, Any]
    changes: dict[str, str]
    observation: Model
    communication: Model
    start: str | None
    data: str | list[str] | None
    weights: list[float] | None
    offline_share: float
    n_threads: int
    n_checkpoints: int
    randomization: Randomization | None = None
    side: str | None = None
    opponents: str | None = None

    def length(self, seeds: Group, *, progress: bool) -> int:
        """Joint steps of a run of some seeds; raises as `describe` does."""
        return self.describe(seeds, progress=progress).run.n_steps

    def run(
        self, seeds: Group, folder: Path, *, progress: bool, report: Report | None = None
    ) -> None:
        """Trains seeds together in a folder."""
        train_run(
            **self.describe(seeds, progress=progress)._asdict(), folder=folder,
            n_threads=self.n_threads, progress=progress, report=report,
        )  # fmt: skip

    def describe(self, seeds: Group, *, progress: bool) -> "_Described":
        """The run of some seeds, and what it takes; raises as `train_online` does."""
        kind = resolve("algorithm", ONLINE_ALGORITHMS, self.algorithm)
        own = find_spec(self.task) if isinstance(self.task, str) else TaskSpec.parse(self.task)
        spec = chosen_models(
            own, self.observation, self.communication, randomization=self.randomization
        )
        who, label = self._opponents(spec)
        acting = _of_side(spec, self.side)
        begin, settings = None, dict[str, str]()
        if self.start is not None:
            begin, settings = begin_with(self.start, kind, acting, features_of(make_task(spec)))
        config = override(kind.Config(), {**settings, **self.changes})
        check_effects(config, self.changes)
        data, recorded = None, None
        if self.data is not None:
            if not hasattr(kind, "mix_in"):
                raise SchemaError(
                    f"{self.algorithm} has no replay of transitions, so that recorded data cannot "
                    "be mixed in. Leave out the data, or use maddpg, vdn or qmix."
                )
            view = {
                "observation": None if self.observation is None else spec.observation,
                "communication": None if self.communication is None else spec.communication,
                "side": self.side,
            }
            data = open_data(self.data, self.weights, {**view, "progress": progress}).split("train")
            check_spec(data, acting)
            recorded = RecordedSource.of(data, self.offline_share)
        run = describe_run(
            self.algorithm, config, _of_side(spec, self.side, label), seeds,
            own=_of_side(own, self.side, label), start=begin, recorded=recorded,
            n_checkpoints=self.n_checkpoints,
        )  # fmt: skip
        return _Described(run, data, who)

    def _opponents(self, spec: TaskSpec) -> tuple[Policy | str | None, str | None]:
        """Who plays the other sides, and its name; checks that there are sides, or none."""
        if self.side is not None and self.opponents is not None:
            return find_opponents(self.opponents, self.side, spec)
        if len(spec.sides) > 1:
            names = ", ".join(side.name for side in spec.sides)
            raise SpecError(
                f"{spec.task} has several sides ({names}), and {self.algorithm} trains one. Give "
                "side (--side) and opponents (--opponents), such as scripted"
            )
        if self.side is not None or self.opponents is not None:
            raise SpecError(
                f"got side {self.side!r} and opponents {self.opponents!r}, but {spec.task} has one "
                "side only; leave them out"
            )
        return None, None


class _Described(NamedTuple):
    """Arguments of `train_run`."""

    run: OnlineRun
    data: Dataset | Mixture | None
    opponents: Policy | str | None


def _of_side(spec: TaskSpec, side: str | None, opponents: str | None = None) -> TaskSpec | SideSpec:
    return spec if side is None else SideSpec(whole=spec, side=side, opponents=opponents)


def seed_trainer() -> Handler:
    """Returns what trains a group of seeds in a process, a job of `seed_jobs`."""

    def handle(payload: dict[str, Any], report: Report) -> None:
        kind: type[OfflineTraining | OnlineTraining]
        kind = OnlineTraining if "task" in payload["training"] else OfflineTraining
        training, seeds = kind.parse(payload["training"]), tuple(payload["seeds"])
        training.run(seeds, Path(payload["folder"]), progress=False, report=report)

    return handle


def train(
    algorithm: str,
    dataset_id: str | Path | Sequence[str | Path],
    out: Path | str,
    *,
    weights: Sequence[float] | None = None,
    n_seeds: int = DEFAULT_SEEDS,
    changes: Mapping[str, Any] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    rewards: RewardChoice | None = None,
    side: str | None = None,
    frame: str = "auto",
    curve_every: int = 1000,
    keep: bool = False,
    device: str = "cpu",
    compile: bool = False,
    workers: int = 1,
    engine: str | Executor = LOCAL,
    part: tuple[int, int] | None = None,
    progress: bool = True,
) -> list[Policy]:
    """Trains seeds 0, 1, ... together on the train split; resumes an interrupted run in `out`.

    Several processes train groups of the seeds in folders `out/seeds-...`; together they are the
    same run, and `find_target` and reports take `out` in either case.

    Args:
        algorithm: registered offline algorithm; or `auto`, which chooses one for the dataset by
            statistics of its episodes (`runs.algorithm_choice`), logs which and why, and trains it.
        dataset_id: id or folder of a dataset, as `load` takes it, or several to mix. On recordings
            of other environments there is no learning curve; evaluate with
            `swarmdata.evaluate_parallel` afterwards. On data of an older version of the world there
            is none either, since that world is not simulated.
        out: run folder.
        weights: of several datasets, as `load` takes them.
        n_seeds: number of seeds.
        changes: settings of the algorithm, such as `{"n_updates": 50}`; text is read as by `--set`.
        observation: observation model for training and evaluation; None: as recorded.
        communication: communication model, likewise.
        rewards: rewards to learn from, as `load` takes them; learning curves and evaluations stay
            on those of the task.
        side: the side to learn for, in a task of several; it has no learning curve, since that
            takes opponents.
        frame: anchor of the frame of observations and actions, as `frames.find_frame` takes it.
        curve_every: updates between two points of the learning curve.
        keep: whether to keep all checkpoints, so that `rank` can compare them.
        device: torch device.
        compile: whether to compile the updates, as `train_seeds` takes it.
        workers: processes of the engine `local`, each with an equal share of the seeds; 1: this
            one, in `out` itself.
        engine: where seeds are trained, as `build` takes it, each for itself; all processes see
            `out` and the datasets.
        part: (k, N): train only the k-th of N groups of the seeds, here; for schedulers.
        progress: whether to show progress bars.

    Returns:
        One policy for each seed; of `part`, for each seed of its group.

    Raises:
        UnknownNameError: no such algorithm, dataset or setting.
        SpecError: the task has no such frame, an argument or setting is not of its type, or `auto`
            got a mixture.
        ProgramError: `compile` found no working compiler.
        OutputError: `out` has files and holds no run.
        CheckpointError: `out` holds another run.
        BuildError: `out` holds other groups of seeds, or training failed in another process.
    """
    arguments = {
        "algorithm": algorithm, "dataset_id": _portable_names("dataset_id", dataset_id),
        "weights": None if weights is None else list(weights), "changes": as_texts(changes or {}),
        "observation": portable_source(observation),
        "communication": portable_source(communication),
        "rewards": dict(rewards) if isinstance(rewards, Mapping) else rewards,
        "side": side, "frame": frame, "curve_every": curve_every, "keep": keep, "device": device,
        "compile": compile,
    }  # fmt: skip
    training = OfflineTraining.parse(arguments, "the arguments of train")
    if not isinstance(n_seeds, int | np.integer) or n_seeds < 1:
        raise SpecError(f"n_seeds is {n_seeds!r:.100}, expected a whole number of at least 1")
    if algorithm == AUTO:
        choice = choose_for(training.data(progress=progress))
        training = training.model_copy(update={"algorithm": choice.algorithm})
    where: JobOptions = {"engine": engine, "workers": workers, "progress": progress}
    found = train_in_groups(training, Path(out), tuple(range(n_seeds)), part, where)
    return read_trained(Path(out)).policies() if found is None else found


def train_online(
    algorithm: str,
    task: str | Path | TaskSpec,
    out: Path | str,
    *,
    seeds: Sequence[int] = range(DEFAULT_ONLINE_SEEDS),
    changes: Mapping[str, Any] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    randomization: Ranges | None = None,
    start: Path | str | None = None,
    data: str | Path | Sequence[str | Path] | None = None,
    weights: Sequence[float] | None = None,
    offline_share: float = 0.5,
    side: str | None = None,
    opponents: Path | str | None = None,
    workers: int = 1,
    engine: str | Executor = LOCAL,
    part: tuple[int, int] | None = None,
    n_threads: int = 1,
    n_checkpoints: int = 40,
    progress: bool = True,
) -> None:
    """Trains seeds together in `out`; several processes train in folders `out/seeds-...`.

    Args:
        algorithm: registered online algorithm.
        task: to train in: a preset's name, a spec file, or a spec.
        out: run folder; an interrupted run in it resumes.
        seeds: of the policies.
        changes: settings of the algorithm, as `train` takes them.
        observation: observation model; None: that of the task.
        communication: communication model, likewise.
        randomization: ranges from which each episode draws, such as `{"mass": (1, 2)}`; None:
            those of the task.
        start: an offline run for the task to begin with, a folder or `zoo:ALGORITHM/DATASET`: its
            policies, the frame and statistics of their inputs, the sizes of its networks, and
            critics that fit. Settings that are changed win.
        data: id or folder of a dataset of the task, as `load` takes it, whose train split is mixed
            into the batches of algorithms with a replay; or several datasets.
        weights: of several datasets, as `load` takes them.
        offline_share: part of each batch that `data` give, above 0 and below 1.
        side: that is trained, in a task of several.
        opponents: who plays the other sides: a registered policy, such as `scripted`, or the run
            folder of another side, of which the first seed plays.
        workers: processes of the engine `local`, each with an equal share of the seeds; 1: this
            one, in `out` itself.
        engine: where seeds are trained, as `train` takes it.
        part: (k, N): train only the k-th of N groups of the seeds, here; for schedulers.
        n_threads: threads of each process that step its worlds, as `make_env` takes it.
        n_checkpoints: how often policies are evaluated and the run is saved.
        progress: whether to show progress bars.

    Raises:
        UnknownNameError: no such algorithm, task, dataset or setting.
        OutputError: `out` has files and holds no run.
        BuildError: `out` holds other groups of seeds, or training failed in another process.
        CheckpointError: a folder holds another run; or `start` is no offline run for this task, or
            has other seeds or policies than the algorithm can take.
        SchemaError: the algorithm has no replay, or `data` are of another task.
        SpecError: the task is of an older version of the world, the share is out of its range, or
            an argument or setting is not of its type.
    """
    arguments = {
        "algorithm": algorithm, "changes": as_texts(changes or {}),
        "task": portable_source(task if isinstance(task, str) else find_spec(task)),
        "observation": portable_source(observation),
        "communication": portable_source(communication),
        "randomization": None if randomization is None else ranges_of(randomization),
        "start": _portable_names("start", start), "data": _portable_names("data", data),
        "side": side, "opponents": _portable_names("opponents", opponents),
        "weights": None if weights is None else [*weights],
        "offline_share": offline_share, "n_threads": n_threads, "n_checkpoints": n_checkpoints,
    }  # fmt: skip
    training = OnlineTraining.parse(arguments, "the arguments of train_online")
    found = tuple(seeds)
    _check_seeds(found)
    where: JobOptions = {"engine": engine, "workers": workers, "progress": progress}
    train_in_groups(training, Path(out), tuple(map(int, found)), part, where)


def _check_seeds(seeds: Sequence[Any]) -> None:
    are_whole = all(isinstance(each, int | np.integer) and each >= 0 for each in seeds)
    if not (seeds and are_whole and len({*seeds}) == len(seeds)):
        raise SpecError(f"seeds are {seeds!r:.100}, expected different whole numbers from 0 on")


def _portable_names(
    argument: str, names: str | Path | Sequence[str | Path] | None
) -> str | list[str] | None:
    """One dataset or run, or several, by names that mean the same in any process."""
    if names is None:
        return None
    is_data = argument in ("dataset_id", "data")
    expected = "the id or folder of a dataset" if is_data else "the name of a policy or run folder"
    given = list_of(argument, names, expected, OPEN_AGAIN if is_data else "")
    found = [portable_name(each) for each in given]
    return found[0] if isinstance(names, str | Path) else found


def open_data(
    dataset_id: str | Sequence[str], weights: Sequence[float] | None, view: Mapping[str, Any]
) -> Dataset | Mixture:
    """Opens one dataset by id or folder, or several as a mixture; `view`: arguments of `load`.

    Raises:
        SpecError: another package defines a dataset's task, and is not installed.
    """
    if isinstance(dataset_id, str) and weights is None:
        data: Dataset | Mixture = load(dataset_id, **view)
    else:
        several = (dataset_id,) if isinstance(dataset_id, str) else tuple(dataset_id)
        data = load(several, weights=weights, **view)
    for part in data.parts if isinstance(data, Mixture) else (data,):
        check_installed(part.recipe, "training")
    return data


def last_evaluation(
    run: Path, dataset_id: str | Sequence[str], weights: Sequence[float] | None
) -> str | None:
    """Says in one line how good the policies of an offline run are, beside its data.

    By scores, or by returns where there are no references; None: there is no learning curve.
    """
    if not (last := _last_rows(run, "update")):
        return None
    data = open_data(dataset_id, weights, {"progress": False})
    parts = data.parts if isinstance(data, Mixture) else (data,)
    has_score = parts[0].references is not None

    def mean(values: Any) -> str:
        found = data.normalized_score(values) if has_score else np.asarray(values)
        return f"{found.mean():.1f}" if has_score else f"{found.mean():.3g}"

    success = np.mean([row["success"] for row in last])
    own = ", ".join(f"{mean(part.episodes.team_return)} ({part.id})" for part in parts)
    what = "score" if has_score else "return"
    return (
        f"After {last[0]['update']:,.0f} updates, {_have(last)} a mean {what} of "
        f"{mean([row['return'] for row in last])}, and {success:.0%} success in {CURVE_EPISODES} "
        f"validation episodes; the data have {own}."
    )


def last_online_evaluation(run: Path) -> str | None:
    """Says in one line how good the newest policies of an online run are; None: not measured."""
    if not (last := _last_rows(run, "frames")):
        return None
    measured = (np.mean([row[name] for row in last]) for name in ("return", "success"))
    return (
        f"After {last[0]['frames']:,.0f} joint steps, {_have(last)} a mean return of "
        "{:.3g}, and {:.0%} success in validation episodes.".format(*measured)
    )


def _last_rows(run: Path, clock: str) -> list[dict[str, float]]:
    """The rows of the learning curve, of all seeds, at which most was learned."""
    tables = [part / CURVE for part in run_folders(run)]
    rows = [row for table in tables if table.is_file() for row in read_table(table)]
    newest = max((row[clock] for row in rows), default=0.0)
    return [row for row in rows if row[clock] == newest]


def _have(rows: Sequence[object]) -> str:
    return "1 seed has" if len(rows) == 1 else f"{len(rows)} seeds have"


def read_settings(name: str) -> dict[str, str]:
    """Reads settings as texts, as of `--set`, of a file in `online_algos/configs` or a path."""
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
    measured = measure(policy, spec, n_episodes)
    return {name: measured[name] for name in CURVE_METRICS}
