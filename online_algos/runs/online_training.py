"""Trains K seeds of an online algorithm at once, in a folder from which it can be resumed.

config.json             the complete description of the run (`OnlineRun`)
curve.csv               metrics and losses of every seed at every checkpoint
speed.csv               wall-clock time, frames a second and memory at every checkpoint
policies/seed-K/        greedy policies, `<frames>.safetensors`, `POLICIES_PER_CHECKPOINT` of each
tensorboard/seed-K/     the curve as TensorBoard event files
checkpoint.safetensors  the complete state, to continue from
replay/                 transitions, of algorithms with a replay buffer

Frames are joint steps of one seed. A run is a pure function of its `config.json`, of the offline
run that it starts from and of the data that it mixes in, if it does: killed at any moment and
started again, it ends with the same curve and the same policies, bit for bit, on the same machine.
A run that starts from an offline run has a row of its curve at 0 frames, with the scores of that
run's policies.
"""

import dataclasses
import json
import math
import resource
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field
from tensorboardX import SummaryWriter
from tqdm import tqdm

from swarmdata.errors import BuildError, CheckpointError, SpecError, SwarmdataError
from swarmdata.interfaces import OnlineAlgorithm, Policy
from swarmdata.learn.policies.policy_file import save_policy
from swarmdata.learn.training.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.learn.training.divergence import check_finite
from swarmdata.learn.training.overrides import from_json
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG, CURVE, SPEED
from swarmdata.learn.training.run_folder import Table, versions
from swarmdata.learn.training.training_data import Data
from swarmdata.numerics.random import validation_seeds
from swarmdata.online_algos.collection.recorded_rows import RecordedSource
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    StartSource,
    read_start,
)
from swarmdata.online_algos.runs.seed_files import policy_path
from swarmdata.registry.components import ONLINE_ALGORITHMS, make_env, resolve
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import check_marked
from swarmdata.runtime.thread_limits import ThreadLimit
from swarmdata.specs.frozen import Frozen, describe_differences
from swarmdata.specs.task_spec import TaskSpec

REPLAY_FOLDER = "replay"
"""Folder of a running training's replay, if its algorithm has one."""

POLICIES_PER_CHECKPOINT = 5
"""Policies saved per checkpoint: medium-replay datasets need the way to a medium in small steps."""

MEASURED_METRICS = (
    "success",
    "clean_success",
    "return",
    "robot_collisions",
    "obstacle_collisions",
    "length",
)
"""Columns of the curve that are means over validation episodes."""

Count = Annotated[int, Field(ge=1)]


class OnlineRun(Frozen):
    """Everything that decides the result of an online training run, and the versions it used."""

    format_version: Literal[1] = 1
    algorithm: str
    config: dict[str, Any]  # of the algorithm, with all defaults
    spec: TaskSpec
    own_spec: TaskSpec | None = None  # the task as it is, where `spec` differs; None: `spec`
    seeds: Annotated[tuple[int, ...], Field(min_length=1)]
    n_checkpoints: Count = 40
    n_episodes: Count = 128  # validation episodes of each seed and checkpoint
    start: StartSource | None = None  # offline run that it begins with
    recorded: RecordedSource | None = None  # data that are mixed into its batches
    versions: dict[str, str]

    @property
    def n_steps(self) -> int:
        """Joint steps that each seed takes; runs of earlier versions call it `n_frames`."""
        return int(self.config.get("n_frames", self.config["n_steps"]))

    def build(self, folder: Path, data: Data | None = None, n_threads: int = 1) -> OnlineAlgorithm:
        """Makes the algorithm as it is before its first update, and before it takes over a start.

        Args:
            folder: of the replay.
            data: those that `recorded` describes.
            n_threads: threads that step the worlds; the result does not depend on it.
        """
        kind = resolve("algorithm", ONLINE_ALGORITHMS, self.algorithm)
        config = from_json(kind.Config, self.config)
        env = make_env(self.spec, config.n_copies * len(self.seeds), n_threads=n_threads)
        algorithm: Any = kind(env, self.seeds, config, folder)
        if self.recorded is not None and data is not None:
            algorithm.mix_in(data, self.recorded.share)
        return cast("OnlineAlgorithm", algorithm)


def describe_run(
    algorithm: str,
    config: Any,
    spec: TaskSpec,
    seeds: Sequence[int],
    *,
    own: TaskSpec | None = None,
    start: OfflineStart | None = None,
    recorded: RecordedSource | None = None,
    **options: int,
) -> OnlineRun:
    """Returns the run of an algorithm with one of its configs.

    Args:
        algorithm: registered name.
        config: of the algorithm.
        spec: of the task.
        seeds: of the policies.
        own: spec of the task with its own models; None: `spec`.
        start: offline run to begin with.
        recorded: data to mix in.
        **options: numbers of checkpoints and of episodes.
    """
    return OnlineRun.parse(
        {
            "algorithm": algorithm,
            "config": json.loads(json.dumps(dataclasses.asdict(config))),  # lists for tuples
            "spec": spec.model_dump(mode="json"),
            "own_spec": None if own in (None, spec) else own.model_dump(mode="json"),
            "seeds": list(seeds),
            "start": None if start is None else start.source.model_dump(mode="json"),
            "recorded": None if recorded is None else recorded.model_dump(mode="json"),
            "versions": versions(),
            **options,
        },
        algorithm,
    )


def measure(
    policy: Policy, spec: TaskSpec, n_episodes: int, n_threads: int = 1
) -> dict[str, float]:
    """Returns a policy's mean metrics on the validation seeds."""
    seeds = validation_seeds(n_episodes)
    with closing(make_env(spec, min(64, n_episodes), n_threads=n_threads)) as env:
        rows = [episode_metrics(episode, env.task) for episode in rollout(env, policy, seeds)]
    return {name: float(np.mean([row[name] for row in rows])) for name in MEASURED_METRICS}


def train_run(
    run: OnlineRun,
    folder: Path,
    *,
    data: Data | None = None,
    n_threads: int = 1,
    progress: bool = True,
    report: Callable[[int], object] = lambda steps: None,
) -> Path:
    """Trains a run, or continues it where it stopped; returns its folder.

    If another process trains in the folder, this one waits for it.

    Args:
        run: what to train.
        folder: of the run; made if absent.
        data: those that the run mixes in.
        n_threads: threads that step the worlds, as `make_env` takes it.
        progress: whether to show a bar (on standard error, if that is a terminal).
        report: is told after every update how many joint steps each seed has made since the last.

    Raises:
        OutputError: the folder has files and holds no run.
        BuildError: the folder holds another run.
        CheckpointError: the offline run to start from does not fit, or is not the one described.
        DivergedError: a loss or a parameter became infinite or NaN; the last checkpoint is kept.
        SchemaError: the data are not those described.
        SpecError: the run is shorter than one rollout, the replay buffer is too small to resume
            from checkpoints, or a setting of the algorithm is wrong.
    """
    _check_lengths(run)
    if run.recorded is not None:
        run.recorded.check(data)
    with ThreadLimit(), locked(folder / CONFIG, progress):
        _claim(folder, run)
        path = folder / CHECKPOINT
        if not path.exists() or load_checkpoint(path)[1]["frames"] < run.n_steps:
            _begin(run, folder, data, n_threads).finish(progress, report)
        if (folder / REPLAY_FOLDER).exists():  # gigabytes that a finished run does not need
            shutil.rmtree(folder / REPLAY_FOLDER)
    return folder


def read_online_run(folder: Path) -> OnlineRun:
    """Reads a run folder's `config.json`.

    Raises:
        SpecError: it is malformed.
    """
    return OnlineRun.from_file(folder / CONFIG)


def _check_lengths(run: OnlineRun) -> None:
    """Checks that there is a rollout, and that the replay can be resumed from every checkpoint.

    The replay buffer must keep the transitions that a checkpoint samples from until the next one,
    `training.replay_buffer`.
    """
    per_rollout = run.config["n_copies"] * run.config.get("rollout_steps", 1)
    if run.n_steps < per_rollout:
        raise SpecError(
            f"n_steps is {run.n_steps}, the joint steps of the whole training, expected at least "
            f"the {per_rollout} of one rollout. The length of a rollout is called 'rollout_steps'."
        )
    margin = run.config.get("margin")
    needed = math.ceil(run.n_steps / run.n_checkpoints + per_rollout)
    if margin is not None and margin < needed:
        raise SpecError(
            f"margin is {margin}, expected at least {needed} joint steps, as many as lie between "
            f"two of {run.n_checkpoints} checkpoints: otherwise a run that is killed could not be "
            "resumed. Increase margin, or train fewer steps."
        )


def _claim(folder: Path, run: OnlineRun) -> None:
    """Writes the run's description into its folder, or checks that it is there."""
    check_marked(folder, CONFIG, "run folder")
    if not (folder / CONFIG).exists():
        write_file(folder / CONFIG, run.to_json().encode())
        return
    if different := describe_differences(read_online_run(folder), run):
        raise BuildError(
            f"{folder} holds another run, which differs in: {different}. Choose another folder, or "
            "move that one away."
        )


def _begin(run: OnlineRun, folder: Path, data: Data | None, n_threads: int) -> "_Training":
    """Builds or loads a run; empties its folder if that fails before the first checkpoint."""
    try:
        return _Training(run, folder, data, n_threads)
    except SwarmdataError:
        if not (folder / CHECKPOINT).exists():
            if (folder / REPLAY_FOLDER).exists():  # `_claim` made sure that it is this run's
                shutil.rmtree(folder / REPLAY_FOLDER)
            (folder / CONFIG).unlink()
        raise


class _Training:
    """The training loop: it updates, measures, logs and saves."""

    def __init__(self, run: OnlineRun, folder: Path, data: Data | None, n_threads: int) -> None:
        self.run, self.folder, self.n_threads = run, folder, n_threads
        self.algorithm = run.build(folder / REPLAY_FOLDER, data, n_threads)
        is_new = not (folder / CHECKPOINT).exists()
        if not is_new:
            self.algorithm.load_state_dict(load_checkpoint(folder / CHECKPOINT)[0])
        elif run.start is not None:
            _take_over(run.start, self.algorithm)
        elif self.algorithm.prepare():
            self._keep_state()
        self.first = self.algorithm.frames
        losses = resolve("algorithm", ONLINE_ALGORITHMS, run.algorithm).LOSSES
        columns = (*MEASURED_METRICS, *losses)
        last = -1 if is_new else self.first  # rows of a start that a crash cut short are dropped
        self.curve = Table(folder / CURVE, columns, last, ("frames", "seed"))
        self.speed = Table(
            folder / SPEED, ("seconds", "frames_per_second", "memory_mb"), self.first,
            ("frames", "n_seeds"),
        )  # fmt: skip
        self.writers = [
            SummaryWriter(str(folder / "tensorboard" / f"seed-{seed}"), purge_step=self.first + 1)
            for seed in run.seeds
        ]
        if is_new and run.start is not None:
            self._checkpoint({})

    def finish(self, progress: bool, report: Callable[[int], object]) -> None:
        n_steps, algorithm = self.run.n_steps, self.algorithm
        every = n_steps / self.run.n_checkpoints
        started, since = time.perf_counter(), self.first
        with tqdm(
            total=n_steps, initial=self.first, unit="frame", unit_scale=True,
            desc=self.folder.name, disable=None if progress else True,
        ) as bar:  # fmt: skip
            while algorithm.frames < n_steps:
                before = algorithm.frames
                losses = self._update()
                bar.update(algorithm.frames - before)
                report(algorithm.frames - before)
                is_last = algorithm.frames >= n_steps
                if is_last or _crosses(every / POLICIES_PER_CHECKPOINT, before, algorithm.frames):
                    self._save_policies()
                if is_last or _crosses(every, before, algorithm.frames):
                    self._log_speed(time.perf_counter() - started, algorithm.frames - since)
                    self._checkpoint(losses)
                    started, since = time.perf_counter(), algorithm.frames
        for writer in self.writers:
            writer.close()

    def _update(self) -> Mapping[str, Any]:
        """One update; worlds refuse actions of policies that have diverged."""
        try:
            return self.algorithm.update()
        except SwarmdataError:
            self._check_finite()
            raise

    def _check_finite(self) -> None:
        state = self.algorithm.state_dict()
        check_finite(state, "the algorithm's tensors", self.algorithm.frames, self.folder)

    def _save_policies(self) -> None:
        self._check_finite()
        for k, seed in enumerate(self.run.seeds):
            path = policy_path(self.folder, seed, self.algorithm.frames)
            save_policy(path, self.algorithm.policy(k))

    def _checkpoint(self, losses: Mapping[str, Any]) -> None:
        """Saves the metrics of the policies, and then the state to continue from."""
        frames, run = self.algorithm.frames, self.run
        for k, seed in enumerate(run.seeds):
            row = measure(self.algorithm.policy(k), run.spec, run.n_episodes, self.n_threads)
            own = {name: float(loss[k]) for name, loss in losses.items()}
            defined = {name: value for name, value in own.items() if not math.isnan(value)}
            check_finite(defined, f"the losses of seed {seed}", frames, self.folder)
            row |= defined
            self.curve.append(frames, seed, row)
            for name, value in row.items():
                self.writers[k].add_scalar(name, value, frames)
            self.writers[k].flush()
        self._keep_state()

    def _keep_state(self) -> None:
        state, frames = self.algorithm.state_dict(), self.algorithm.frames
        save_checkpoint(self.folder / CHECKPOINT, state, {"frames": frames})
        self.algorithm.restart_worlds()  # as a run that continues from this state does

    def _log_speed(self, seconds: float, frames: int) -> None:
        """Logs the speed since the last checkpoint, of all seeds together, without evaluation."""
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MB on Linux
        figures = {
            "seconds": seconds,
            "frames_per_second": frames * len(self.run.seeds) / seconds,
            "memory_mb": memory,
        }
        self.speed.append(self.algorithm.frames, len(self.run.seeds), figures)


def _take_over(source: StartSource, algorithm: Any) -> None:
    """Gives an untrained algorithm what fits of the offline run; tells what does not."""
    start = read_start(source.folder)
    if start.source != source:
        raise CheckpointError(
            f"{source.folder} has changed since this training was described. Train again in "
            "another folder."
        )
    for sentence in algorithm.start_from(start):
        tqdm.write(sentence, file=sys.stderr)


def _crosses(every: float, before: int, after: int) -> bool:
    """Whether a multiple of `every` lies after `before`, up to `after`."""
    return after // every > before // every
