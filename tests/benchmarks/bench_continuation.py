"""Offline to online: training that goes on from offline runs, beside training from scratch.

    python -m tests.benchmarks.bench_continuation --out runs/continuation

For `vdn`, `qmix` and `maddpg` it trains an offline run on the dataset, and goes on from it in the
world: with recorded rows as a share of every batch, and without. The same algorithm with the same
networks and batches from scratch takes as many joint steps. All are played on the same validation
episodes.
It prints the table of docs/online-learning.md, and draws the curves beside the runs.

Every run is kept in the folder `--out`; the same command goes on with what is not finished.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch

from swarmdata import load
from swarmdata.evaluation.results.curve_plots import plot_curves
from swarmdata.evaluation.results.learning_curves import Curve, read_curve
from swarmdata.evaluation.runs.train import train
from swarmdata.learn.training.overrides import override
from swarmdata.learn.training.run_files import CURVE
from swarmdata.online_algos.collection.recorded_rows import RecordedSource
from swarmdata.online_algos.continuation.offline_start import read_start
from swarmdata.online_algos.runs.online_training import describe_run, train_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import (
    OFFLINE_ALGORITHMS,
    ONLINE_ALGORITHMS,
    make_task,
    resolve,
)
from swarmdata.registry.published import normalized_score, references_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double
from tests.benchmarks.measuring import table

METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions")


class Start(NamedTuple):
    """What an online algorithm goes on from."""

    offline: str  # algorithm
    settings: Mapping[str, str]
    networks: tuple[str, ...]  # settings of the sizes of networks, offline and online


STARTS = {
    "vdn": Start("vdn", {"regulariser": "cql"}, ("hidden",)),
    "qmix": Start("qmix", {"regulariser": "cql"}, ("hidden",)),
    "maddpg": Start("maddpg_bc", {}, ("actor_hidden", "critic_hidden")),
}
"""By the online algorithm."""


@dataclass(frozen=True)
class Budget:
    """How much is trained and measured."""

    n_updates: int = 3_000  # offline
    n_steps: int = 200_000  # joint steps online
    n_points: int = 4  # of a curve, after the first
    batch_size: int = 128
    units: int = 64  # in each of two hidden layers
    n_seeds: int = 3
    n_episodes: int = 128


@dataclass(frozen=True)
class Bench:
    """Trains the runs of one dataset in a folder."""

    dataset_id: str
    task: TaskSpec  # that it was recorded in
    folder: Path
    budget: Budget

    def settings(self, algorithm: str) -> dict[str, str]:
        """Settings that all runs of an online algorithm share, and the offline one."""
        units = f"{self.budget.units},{self.budget.units}"
        networks = dict.fromkeys(STARTS[algorithm].networks, units)
        return {"batch_size": str(self.budget.batch_size), **networks}

    def offline(self, algorithm: str) -> Path:
        """Trains what an online algorithm goes on from; returns the run."""
        start, folder = STARTS[algorithm], self.folder / f"{algorithm}-offline"
        default = resolve("algorithm", OFFLINE_ALGORITHMS, start.offline).Config()
        changes = {"n_updates": str(self.budget.n_updates), **self.settings(algorithm)}
        if hasattr(default, "bc_warmup_updates"):  # which keeps its share of the updates
            share = default.bc_warmup_updates / default.n_updates
            changes["bc_warmup_updates"] = str(round(share * self.budget.n_updates))
        train(
            start.offline, self.dataset_id, folder, n_seeds=self.budget.n_seeds,
            changes={**changes, **start.settings}, curve_every=self.budget.n_updates,
            progress=False,
        )  # fmt: skip
        return folder

    def online(self, algorithm: str, name: str, begin: Path | None, share: float | None) -> Path:
        """Trains in the world; returns the run.

        Args:
            algorithm: registered name.
            name: of the run.
            begin: offline run to go on from; None for scratch.
            share: of each batch that is recorded; None for none.
        """
        kind = resolve("algorithm", ONLINE_ALGORITHMS, algorithm)
        start = None if begin is None else read_start(begin)
        taken = {} if start is None else kind.settings_of(start, features_of(make_task(self.task)))
        changes = {"n_steps": str(self.budget.n_steps), **self.settings(algorithm)}
        data = None if share is None else load(self.dataset_id).split("train")
        run = describe_run(
            algorithm, override(kind.Config(), {**taken, **changes}), self.task,
            range(self.budget.n_seeds), start=start,
            recorded=None if data is None else RecordedSource.of(data, share or 0.0),
            n_checkpoints=self.budget.n_points, n_episodes=self.budget.n_episodes,
        )  # fmt: skip
        return train_run(run, self.folder / f"{algorithm}-{name}", data=data, progress=False)

    def curves(self, algorithm: str, share: float) -> dict[str, dict[str, Curve]]:
        """Trains an algorithm in three ways; returns the curves of each metric, by way."""
        begin = self.offline(algorithm)
        runs = {
            f"goes on, share {share:g}": self.online(algorithm, "mixed", begin, share),
            "goes on, no data": self.online(algorithm, "alone", begin, None),
            "from scratch": self.online(algorithm, "scratch", None, None),
        }
        return {
            way: {m: read_curve([run / CURVE], m, progress="frames") for m in METRICS}
            for way, run in runs.items()
        }


def scored(curve: Curve, task: TaskSpec) -> Curve:
    """Scores of returns.

    Raises:
        ValueError: the returns of no skill and of the expert were not measured in the task.
    """
    known = references_of(task.hash())
    if known is None or known.reference is None:
        raise ValueError(f"no references were measured in {task.task}, expected those of a preset")
    return Curve(curve.progress, normalized_score(curve.values, known.reference))


def rows_of(
    algorithm: str, ways: Mapping[str, Mapping[str, Curve]], task: TaskSpec
) -> list[tuple[str, ...]]:
    """The rows of one algorithm: scores at each point, and what the last policies do."""
    steps = sorted({int(p) for curves in ways.values() for p in curves["return"].progress})
    rows = []
    for way, curves in ways.items():
        curve = scored(curves["return"], task)
        places = {int(step): curve.values[:, i] for i, step in enumerate(curve.progress)}
        scores = (shown(places[step]) if step in places else "" for step in steps)
        last = {name: curves[name].values[:, -1].mean() for name in METRICS}
        shares = " / ".join(f"{100 * last[name]:.0f} %" for name in METRICS[1:3])
        collisions = " / ".join(f"{last[name]:.2f}" for name in METRICS[3:])
        rows.append((f"`{algorithm}` {way}", *scores, shares, collisions))
    return rows


def shown(scores: Double) -> str:
    """The mean of the seeds' scores, with the lowest and the highest."""
    return f"{scores.mean():.1f} ({scores.min():.0f} to {scores.max():.0f})"


def head_of(ways: Mapping[str, Mapping[str, Curve]]) -> tuple[str, ...]:
    """The head of the table."""
    steps = sorted({int(p) for curves in ways.values() for p in curves["return"].progress})
    return (
        "score after joint steps", *(f"{step:,}" for step in steps),
        "success / clean", "collisions, robot / obstacle",
    )  # fmt: skip


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--dataset", default="coop_nav-medium-replay")
    parser.add_argument("--algorithms", nargs="+", default=tuple(STARTS), choices=tuple(STARTS))
    parser.add_argument("--share", type=float, default=0.5)
    parser.add_argument("--updates", type=int, default=Budget.n_updates)
    parser.add_argument("--steps", type=int, default=Budget.n_steps)
    parser.add_argument("--points", type=int, default=Budget.n_points)
    parser.add_argument("--batch", type=int, default=Budget.batch_size)
    parser.add_argument("--units", type=int, default=Budget.units)
    parser.add_argument("--seeds", type=int, default=Budget.n_seeds)
    parser.add_argument("--episodes", type=int, default=Budget.n_episodes)
    parser.add_argument("--out", type=Path, default=Path("runs/continuation"))
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains what is not there yet, prints the tables, and draws the curves."""
    given: Any = parsed(arguments)
    torch.set_num_threads(1)
    task = load(given.dataset).spec.world
    assert task is not None, f"{given.dataset} is a recording of another environment"
    budget = Budget(
        given.updates, given.steps, given.points, given.batch, given.units, given.seeds,
        given.episodes,
    )  # fmt: skip
    bench = Bench(given.dataset, task, given.out, budget)
    for algorithm in given.algorithms:
        ways = bench.curves(algorithm, given.share)
        print(table(head_of(ways), rows_of(algorithm, ways, task)), flush=True)
        scores = {way: scored(curves["return"], task) for way, curves in ways.items()}
        plot_curves(scores, given.out / f"{algorithm}.png", ylabel="score", xlabel="joint steps")


if __name__ == "__main__":
    main()
