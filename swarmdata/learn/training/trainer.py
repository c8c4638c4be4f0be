"""Trains K seeds of an offline algorithm at once, in the folder of a `Run`."""

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy, fields_of
from swarmdata.learn.memory.memory_settings import MemorySettings, WindowSettings
from swarmdata.learn.networks.compilation import Compilation, compiling, has_compilable, uncompiled
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.presence import PRESENCE
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.training.run import Run, Table, claimed, versions
from swarmdata.learn.training.run_files import CURVE, LOSSES
from swarmdata.learn.training.run_folder import COMPACT, OfflineRun, restore, tensors_of
from swarmdata.learn.training.training_data import Data, Sampler, Selective, framed
from swarmdata.perception.frames import Frame
from swarmdata.registry.components import DISCRETE_ALGORITHMS, OFFLINE_ALGORITHMS, resolve
from swarmdata.runtime.native_libraries import ThreadLimit, keep_freed_memory
from swarmdata.specs.action_scaling import choices_of, has_choices

Evaluate = Callable[[Policy], Mapping[str, float]]
"""Measures a policy; must return the same for the same policy, with the same names every time."""

Report = Callable[[int], None]


@dataclasses.dataclass(frozen=True, slots=True)
class Schedule:
    """How often, in updates, a run does what else it does."""

    log_every: int = 100
    checkpoint_every: int = 1000
    evaluate_every: int | None = None  # None: no learning curve

    def __post_init__(self) -> None:
        numbers = (
            self.log_every,
            self.checkpoint_every,
            1 if self.evaluate_every is None else self.evaluate_every,
        )
        if min(numbers) < 1 or self.checkpoint_every % self.log_every:
            raise SchemaError(
                f"{self}: expected positive numbers and checkpoint_every a multiple of log_every"
            )


def train_seeds(
    algorithm: str,
    dataset: Data,
    folder: Path | str,
    *,
    seeds: Sequence[int] = (0, 1, 2),
    config: Any = None,
    schedule: Schedule | None = None,
    evaluate: Evaluate | None = None,
    frame: Frame | None = None,
    device: torch.device | str = "cpu",
    keep: bool = False,
    compile: bool = False,
    progress: bool = True,
    report: Report | None = None,
) -> list[Policy]:
    """Trains, or goes on where the run in `folder` stopped, and returns one policy per seed.

    Where another process trains in `folder`, this one waits for it.

    Args:
        algorithm: registered name.
        dataset: what to learn from, usually the train split.
        folder: of the run; made if absent.
        seeds: one policy each, with the bits that it has alone, on a CPU.
        config: of the algorithm; None for its defaults.
        schedule: of losses, checkpoints and evaluations.
        evaluate: measures each seed's policy for the learning curve.
        frame: in which the robots see and act; None for the world's.
        device: where to train.
        keep: whether every checkpoint is kept, to choose among them later: `load_algorithm`.
        compile: whether torch.compile makes kernels first, which takes up to minutes and pays in
            long runs. Results agree with those of `False` within rounding only, so a run goes on
            as it began.
        progress: whether to show a bar (on standard error, if that is a terminal).
        report: is told at every row of the losses how many updates were made since the last one.

    Raises:
        UnknownNameError: no such algorithm.
        SchemaError: the algorithm cannot learn the actions of a recorded environment, needs costs
            that the dataset does not have, has nothing to compile, or has settings of a memory that
            do not fit each other.
        ProgramError: `compile` found no working compiler.
        OutputError: the folder has files and holds no run.
        CheckpointError: the folder holds another run, or a damaged one.
        DivergedError: a loss or a parameter became infinite or NaN; the last checkpoint is kept.
        DiskFullError: no space was left; the same.
        KeyboardInterrupt: Ctrl-C; the folder can be resumed.
    """
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    keep_freed_memory()
    config = kind.Config() if config is None else config
    schedule = schedule or Schedule()
    _check_side(algorithm, dataset)
    _check_actions(algorithm, dataset)
    if compile:
        _check_compilable(algorithm, kind, config)
    dataset, min_return = _select(framed(dataset, frame), config)
    samplers = [sampler_of(dataset, config, seed) for seed in seeds]
    _check_costs(algorithm, kind, dataset, samplers[0])
    description = _describe(
        dataset, samplers[0], config, schedule, algorithm=algorithm, min_return=min_return,
        frame=frame, seeds=tuple(seeds), device=str(device),
        versions=versions(is_compiled=compile, algorithms=algorithm),
    )  # fmt: skip
    context = compiling() if compile else nullcontext()
    with claimed(Path(folder), description, shown=progress) as run:
        statistics = Statistics.measure(dataset, config.discount)
        trainer = _Trainer(run, kind, samplers, statistics, keep=keep, report=report)
        # the networks are too small to gain from more threads
        with ThreadLimit(1), context as trainer.compilation:
            trainer.fit(config.n_updates, evaluate, progress)
    return [trainer.algorithm.policy(index) for index in range(len(seeds))]


def sampler_of(dataset: Data, config: Any, seed: int) -> Sampler:
    """The stream of batches of a seed: transitions, or as many steps of windows with a memory."""
    size = config.batch_size
    if not isinstance(config, WindowSettings) or not config.has_memory:
        return dataset.sampler(size, seed=seed)
    n_windows = config.n_windows(size)
    return dataset.sampler(n_windows, horizon=config.window, burn_in=config.burn_in, seed=seed)


def _check_compilable(algorithm: str, kind: type, config: Any) -> None:
    """Raises SchemaError unless there is something to compile, in reasonable time."""
    if isinstance(config, MemorySettings) and config.has_memory:
        raise SchemaError(
            f"{algorithm} has memory={config.memory}, whose steps one after the other would take "
            "too long to compile. Train it without compiling, or with memory=none."
        )
    if not has_compilable(kind):
        raise SchemaError(
            f"{algorithm} has nothing to compile: no method of {kind.__name__} is marked with "
            "swarmdata.learn.networks.compilation.compilable. Train it without compiling."
        )


def _check_side(algorithm: str, dataset: Data) -> None:
    """Raises SchemaError if the dataset has the rows of several sides."""
    world = dataset.spec.world
    if world is not None and len(world.sides) > 1:
        names = ", ".join(side.name for side in world.sides)
        raise SchemaError(
            f"{dataset.id} has the rows of all sides ({names}), and {algorithm} learns for one. "
            "Train on dataset.side(NAME), with side=NAME or with --side NAME."
        )


def _check_actions(algorithm: str, dataset: Data) -> None:
    """Raises SchemaError unless the algorithm can learn the dataset's kind of actions."""
    if algorithm in DISCRETE_ALGORITHMS:
        choices_of(dataset.spec)  # raises where choices and numbers are mixed
        return
    if names := has_choices(dataset.spec):
        raise SchemaError(
            f"{algorithm} learns continuous actions; in {dataset.id} {', '.join(names)} "
            f"{'chooses' if len(names) == 1 else 'choose'} among discrete ones. These learn "
            f"choices: {', '.join(DISCRETE_ALGORITHMS)}. Or record the environment with continuous "
            "actions, if it has them."
        )


def _check_costs(algorithm: str, kind: type, dataset: Data, sampler: Sampler) -> None:
    """Raises SchemaError if the algorithm learns from costs that the dataset does not have."""
    if "costs" not in (fields_of(kind) or ()):
        return
    if sampler.gather(np.zeros(1, dtype=np.int64), {"costs"}).costs is None:
        raise SchemaError(
            f"{algorithm} learns from costs, which follow from recorded events, and {dataset.id} "
            "has no events. Record or import events, or train iql."
        )


def _select(dataset: Data, config: Any) -> tuple[Data, float | None]:
    """Returns the episodes that the algorithm wants, and the least return that it asked for."""
    if not isinstance(config, Selective):
        return dataset, None
    means = (rewards.mean(axis=1, dtype=np.float64) for (rewards,) in dataset.read("rewards"))
    least = config.least_return(np.array([float(each.sum()) for each in means]))
    return dataset.filter(min_return=least), least


def _describe(
    dataset: Data, sampler: Sampler, config: Any, schedule: Schedule, **others: Any
) -> OfflineRun:
    sizes = Sizes.of(sampler.gather(np.zeros(1, dtype=np.int64)))
    return OfflineRun(
        dataset=dataset.id,
        digest=dataset.digest,
        view=dataset.view,
        n_episodes=len(dataset),
        spec=dataset.spec,
        own_spec=None if dataset.own_spec == dataset.spec else dataset.own_spec,
        spec_hash=dataset.spec.hash(),
        n_agents=sizes.n_agents,
        observation_size=sizes.observation,
        action_size=sizes.action,
        state_size=sizes.state,
        config=dataclasses.asdict(config),
        **dataclasses.asdict(schedule),
        **others,
    )


class _Trainer:
    """The loop: draw, gather, update, and now and then log, evaluate and save."""

    def __init__(
        self,
        run: Run[OfflineRun],
        kind: Any,
        samplers: Sequence[Sampler],
        statistics: Statistics,
        *,
        keep: bool,
        report: Report | None,
    ) -> None:
        self.run, self.samplers, self.statistics = run, samplers, statistics
        self.keep, self.report = keep, report
        named = fields_of(kind)
        self.wanted = None if named is None else {*named, *PRESENCE}
        self.algorithm = run.description.build(statistics, run.description.device)
        if run.has_checkpoint:
            is_compact = run.metadata.get(COMPACT, False)
            restore(self.algorithm, run.state, is_compact=is_compact)
            for sampler, state in zip(samplers, run.metadata["samplers"], strict=True):
                sampler.load_state_dict(state)
        self.update = self.reported = run.now
        self.losses = run.table(LOSSES, kind.LOSSES)
        self.curve: Table | None = None
        self.window: dict[str, list[Tensor]] = {}
        self.compilation: Compilation | None = None
        self.n_told = 0  # of what it compiled

    def fit(self, n_updates: int, evaluate: Evaluate | None, progress: bool) -> None:
        with self.run.bar(n_updates, shown=progress, desc=self.run.description.algorithm) as bar:
            while self.update < n_updates:
                self._step()
                self._report(n_updates, evaluate)
                bar.update()

    def _step(self) -> None:
        index = np.stack([sampler.draw() for sampler in self.samplers])  # [K, B]
        batch = self.samplers[0].gather(index, self.wanted)
        batch = batch.to_torch(self.run.description.device)
        for name, loss in self.algorithm.update(batch).items():
            self.window.setdefault(name, []).append(loss)
        self.update += 1

    def _report(self, n_updates: int, evaluate: Evaluate | None) -> None:
        about, is_last = self.run.description, self.update == n_updates
        if is_last or self.update % about.log_every == 0:
            self._log()
            self._tell()
        if (
            evaluate is not None
            and about.evaluate_every is not None
            and (is_last or self.update % about.evaluate_every == 0)
        ):
            self._evaluate(evaluate)
        if is_last or self.update % about.checkpoint_every == 0:
            samplers = [sampler.state_dict() for sampler in self.samplers]
            self.run.save(
                self.update, self.algorithm.state_dict(), tensors_of(self.statistics),
                keep=self.keep, samplers=samplers,
            )  # fmt: skip

    def _log(self) -> None:
        means = {name: torch.stack(rows).mean(0) for name, rows in self.window.items()}  # [K]
        n_seeds = len(self.run.description.seeds)
        rows = [{n: float(mean[k]) for n, mean in means.items()} for k in range(n_seeds)]
        self.run.log(self.losses, self.update, rows)
        self.window.clear()
        if self.report is not None:
            self.report(self.update - self.reported)
            self.reported = self.update

    def _tell(self) -> None:
        """Says what compiling cost, when something was."""
        if self.compilation is not None and self.compilation.n_graphs > self.n_told:
            name = self.run.description.algorithm
            tqdm.write(f"{name}: {self.compilation}", file=sys.stderr)
            self.n_told = self.compilation.n_graphs

    def _evaluate(self, evaluate: Evaluate) -> None:
        for index, seed in enumerate(self.run.description.seeds):
            with uncompiled():
                measured = evaluate(self.algorithm.policy(index))
            if self.curve is None:
                self.curve = self.run.table(CURVE, tuple(measured))
            self.curve.append(self.update, seed, measured)
