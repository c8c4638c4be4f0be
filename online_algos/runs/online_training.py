"""Trains K seeds of an online algorithm at once, in the folder of a `Run`.

Frames are joint steps of one seed. A run that starts from an offline run has a row of its curve at
0 frames, with the scores of that run's policies.
"""

import dataclasses
import json
import math
import resource
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
from tensorboardX import SummaryWriter
from tqdm import tqdm

from swarmdata.errors import CheckpointError, SpecError, SwarmdataError
from swarmdata.interfaces import OnlineAlgorithm, Policy
from swarmdata.learn.policies.policy_file import save_policy
from swarmdata.learn.training.run import Count, Description, Run, claimed, versions
from swarmdata.learn.training.run_files import CONFIG, CURVE, REPLAY_FOLDER, SPEED, policy_path
from swarmdata.learn.training.settings import from_json
from swarmdata.learn.training.training_data import Data
from swarmdata.online_algos.collection.recorded_rows import RecordedSource
from swarmdata.online_algos.continuation.offline_start import OfflineStart, StartSource, read_start
from swarmdata.registry.components import ONLINE_ALGORITHMS, make_env, resolve
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.side_env import AnyEnv, SideEnv
from swarmdata.rollouts.side_policy import play_sides
from swarmdata.runtime.native_libraries import ThreadLimit
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec

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


class OnlineRun(Description):
    """Everything that decides the result of an online training run, and what it ran on."""

    CLOCK: ClassVar[str] = "frames"

    spec: TaskSpec | SideSpec  # of the whole team, or of a side with its opponents
    own_spec: TaskSpec | SideSpec | None = None  # as it is, where `spec` differs; None: `spec`
    n_checkpoints: Count = 40
    n_episodes: Count = 128  # validation episodes of each seed and checkpoint
    start: StartSource | None = None  # offline run that it begins with
    recorded: RecordedSource | None = None  # data that are mixed into its batches
    versions: dict[str, str]

    @property
    def n_steps(self) -> int:
        return int(self.config["n_steps"])

    def build(
        self,
        folder: Path,
        data: Data | None = None,
        n_threads: int = 1,
        opponents: Policy | str | None = None,
    ) -> OnlineAlgorithm:
        """Makes the algorithm as it is before its first update, and before it takes over a run."""
        kind = resolve("algorithm", ONLINE_ALGORITHMS, self.algorithm)
        config, spec = from_json(kind.Config, self.config), self.spec
        task = spec.whole if isinstance(spec, SideSpec) else spec
        whole = make_env(task, config.n_copies * len(self.seeds), n_threads=n_threads)
        env: AnyEnv = whole
        if isinstance(spec, SideSpec):
            env = SideEnv(whole, spec, _known(opponents, spec))
        algorithm: Any = kind(env, self.seeds, config, folder)
        if self.recorded is not None and data is not None:
            algorithm.mix_in(data, self.recorded.share)
        return cast("OnlineAlgorithm", algorithm)


def describe_run(
    algorithm: str,
    config: Any,
    spec: TaskSpec | SideSpec,
    seeds: Sequence[int],
    *,
    own: TaskSpec | SideSpec | None = None,
    start: OfflineStart | None = None,
    recorded: RecordedSource | None = None,
    **options: int,
) -> OnlineRun:
    """Returns the run of an algorithm with one of its configs; arguments as of `OnlineRun`."""
    task = spec.whole if isinstance(spec, SideSpec) else spec
    return OnlineRun.parse(
        {
            "algorithm": algorithm,
            "config": json.loads(json.dumps(dataclasses.asdict(config))),  # lists for tuples
            "spec": spec,
            "own_spec": None if own == spec else own,
            "seeds": list(seeds),
            "start": None if start is None else start.source,
            "recorded": recorded,
            "versions": versions(online_algorithms=algorithm, tasks=task.task),
            **options,
        },
        algorithm,
    )


def measure(
    policy: Policy,
    spec: TaskSpec | SideSpec,
    n_episodes: int,
    n_threads: int = 1,
    opponents: Policy | str | None = None,
) -> dict[str, float]:
    """Returns a policy's mean metrics on the validation seeds; of a side, against opponents."""
    side = spec if isinstance(spec, SideSpec) else None
    if side is not None:
        policy = play_sides(side.whole, side.side, policy, _known(opponents, side))
    task = spec if isinstance(spec, TaskSpec) else spec.whole
    result = evaluate(
        policy, task, n_episodes=n_episodes, block="validation", side=side, n_threads=n_threads,
        progress=False,
    )  # fmt: skip
    return {name: float(np.mean(result.metrics[name])) for name in MEASURED_METRICS}


def _known(opponents: Policy | str | None, spec: SideSpec) -> Policy | str:
    """The opponents of a side; SpecError without any."""
    if opponents is None:
        raise SpecError(f"{spec.task} needs opponents for the other sides, such as 'scripted'")
    return opponents


def train_run(
    run: OnlineRun,
    folder: Path,
    *,
    data: Data | None = None,
    opponents: Policy | str | None = None,
    n_threads: int = 1,
    progress: bool = True,
    report: Callable[[int], object] | None = None,
) -> Path:
    """Trains a run, or continues it where it stopped; returns its folder.

    Args:
        run: what to train.
        folder: of the run; made if absent.
        data: those that the run mixes in.
        opponents: of a run for a side, those that its spec names, as `play_sides` takes them.
        n_threads: threads that step the worlds, as `make_env` takes it.
        progress: whether to show a bar (on standard error, if that is a terminal).
        report: is told after every update how many joint steps each seed has made since the last.

    Raises:
        OutputError: the folder has files and holds no run.
        CheckpointError: the folder holds another run, or the offline run to start from does not
            fit, or is not the one described.
        DivergedError: a loss or a parameter became infinite or NaN; the last checkpoint is kept.
        SchemaError: the data are not those described.
        SpecError: the run is shorter than one rollout, the replay buffer is too small to resume
            from checkpoints, or a setting of the algorithm is wrong.
    """
    _check_lengths(run)
    if run.recorded is not None:
        run.recorded.check(data)
    with ThreadLimit(), claimed(folder, run, shown=progress) as claim:
        if claim.now < run.n_steps:
            _begin(claim, data, n_threads, opponents).finish(progress, report)
        if (folder / REPLAY_FOLDER).exists():  # gigabytes that a finished run does not need
            shutil.rmtree(folder / REPLAY_FOLDER)
    return folder


def read_online_run(folder: Path) -> OnlineRun:
    """Reads a run folder's `config.json`; SpecError if it is malformed."""
    return OnlineRun.from_file(folder / CONFIG)


def _check_lengths(run: OnlineRun) -> None:
    """Checks that there is a rollout, and that the replay can be resumed from every checkpoint."""
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


def _begin(
    run: Run[OnlineRun], data: Data | None, n_threads: int, opponents: Policy | str | None
) -> "_Training":
    """Builds or loads a run; empties its folder if that fails before the first checkpoint."""
    try:
        return _Training(run, data, n_threads, opponents)
    except SwarmdataError:
        if not run.has_checkpoint:
            if (run.folder / REPLAY_FOLDER).exists():  # `claimed` made sure that it is this run's
                shutil.rmtree(run.folder / REPLAY_FOLDER)
            (run.folder / CONFIG).unlink()
        raise


class _Training:
    """The training loop: it updates, measures, logs and saves."""

    def __init__(
        self,
        run: Run[OnlineRun],
        data: Data | None,
        n_threads: int,
        opponents: Policy | str | None,
    ) -> None:
        self.run, self.about = run, run.description
        self.n_threads, self.opponents = n_threads, opponents
        folder, start = run.folder, run.description.start
        self.algorithm = self.about.build(folder / REPLAY_FOLDER, data, n_threads, opponents)
        if run.has_checkpoint:
            self.algorithm.load_state_dict(run.state)
        elif start is not None:
            _take_over(start, self.algorithm)
        elif self.algorithm.prepare():
            self._keep_state()
        losses = resolve("algorithm", ONLINE_ALGORITHMS, self.about.algorithm).LOSSES
        self.curve = run.table(CURVE, (*MEASURED_METRICS, *losses))
        speeds = ("seconds", "frames_per_second", "memory_mb")
        self.speed = run.table(SPEED, speeds, who="n_seeds")
        self.writers = [
            SummaryWriter(str(folder / "tensorboard" / f"seed-{seed}"), purge_step=run.now + 1)
            for seed in self.about.seeds
        ]

    def finish(self, progress: bool, report: Callable[[int], object] | None) -> None:
        n_steps, algorithm = self.about.n_steps, self.algorithm
        every = n_steps / self.about.n_checkpoints
        if self.about.start is not None and not self.run.has_checkpoint:
            self._checkpoint({})
        started, since = time.perf_counter(), self.run.now
        options = {"unit": "frame", "unit_scale": True, "desc": self.run.folder.name}
        with self.run.bar(n_steps, shown=progress, **options) as bar:
            while algorithm.frames < n_steps:
                before = algorithm.frames
                losses = self._update()
                bar.update(algorithm.frames - before)
                if report is not None:
                    report(algorithm.frames - before)
                is_last = algorithm.frames >= n_steps
                if is_last or _crosses(every / POLICIES_PER_CHECKPOINT, before, algorithm.frames):
                    self._check_finite()
                    for k, seed in enumerate(self.about.seeds):
                        path = policy_path(self.run.folder, seed, self.algorithm.frames)
                        save_policy(path, self.algorithm.policy(k))
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
        self.run.check_finite(state, "the algorithm's tensors", self.algorithm.frames)

    def _checkpoint(self, losses: Mapping[str, Any]) -> None:
        """Saves the metrics of the policies, and then the state to continue from."""
        frames, about, rows = self.algorithm.frames, self.about, []
        for k in range(len(about.seeds)):
            policy = self.algorithm.policy(k)
            row = measure(policy, about.spec, about.n_episodes, self.n_threads, self.opponents)
            own = {name: float(loss[k]) for name, loss in losses.items()}
            rows.append(row | {name: v for name, v in own.items() if not math.isnan(v)})
        self.run.log(self.curve, frames, rows)
        for writer, row in zip(self.writers, rows, strict=True):
            for name, value in row.items():
                writer.add_scalar(name, value, frames)
            writer.flush()
        self._keep_state()

    def _keep_state(self) -> None:
        self.run.save(self.algorithm.frames, self.algorithm.state_dict())
        self.algorithm.restart_worlds()  # as a run that continues from this state does

    def _log_speed(self, seconds: float, frames: int) -> None:
        """Logs the speed since the last checkpoint, of all seeds together, without evaluation."""
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MB on Linux
        n_seeds = len(self.about.seeds)
        figures = {
            "seconds": seconds,
            "frames_per_second": frames * n_seeds / seconds,
            "memory_mb": memory,
        }
        self.speed.append(self.algorithm.frames, n_seeds, figures)


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
