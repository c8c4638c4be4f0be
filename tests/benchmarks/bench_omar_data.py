"""Our algorithms on OMAR's published data of cooperative navigation, beside the paper's table.

    python -m tests.benchmarks.bench_omar_data --data DATASETS --omar CHECKOUT

DATASETS is what the README of ling-pan/OMAR lets one download, with the folders
`simple_spread/{random,medium-replay,medium,expert}/seed_<k>_data` of .npy files for each agent;
CHECKOUT is that repository, whose own world plays what was learned (PettingZoo's has another
reward). The environment variables OMAR_DATA and OMAR name both too; without them, nothing is
measured. `swarmdata.import_dataset` converts the files, all seeds of a kind to one dataset. The
other tasks need the prey that their authors trained, and are not played.
"""

import argparse
import os
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

import swarmdata
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double
from tests.benchmarks.bench_algorithms import our_config, shown
from tests.benchmarks.measuring import table
from tests.benchmarks.peers.particle_world import STEPS, ParticleWorld
from tests.benchmarks.peers.team_data import Budget

KINDS = ("expert", "medium", "medium-replay", "random")

EXPERT, RANDOM = 516.8, 159.8
"""Returns that are 100 and 0 on the score: Zhu et al. 2024 (MADiff, NeurIPS), appendix G.1."""

PAPER = {
    "BC": (35.0, 31.6, 10.0, -0.5),
    "MA-ICQ": (104.0, 29.3, 13.6, 6.3),
    "MA-TD3+BC": (108.3, 29.3, 15.4, 9.8),
    "MA-CQL": (98.2, 34.1, 20.0, 24.0),
    "OMAR": (114.9, 47.9, 37.9, 34.4),
}
"""Scores by kind, in the order of `KINDS`: table 1 of MADiff, where those of MA-ICQ to OMAR are
copied from Pan et al. 2022 (OMAR). The settings of CQL and OMAR were chosen for each kind."""


def normalized(returns: Double) -> Double:
    """Scores of returns."""
    return 100.0 * (returns - RANDOM) / (EXPERT - RANDOM)


def convert(folder: Path, kind: str, out: Path) -> swarmdata.Dataset:
    """Imports all seeds of one kind.

    Args:
        folder: with the folders `seed_<k>_data`.
        kind: one of `KINDS`.
        out: where the dataset appears.
    """
    ends = [np.load(path, mmap_mode="r") for path in sorted(folder.glob("**/dones_0.npy"))]
    has_flags = all(each.any() for each in ends)
    return swarmdata.import_dataset(
        folder,
        out,
        format="numpy",
        id=f"simple_spread-omar_{kind.replace('-', '_')}-v0",
        choices=Choices(
            time_limit=STEPS,
            episode_length=None if has_flags else STEPS,
            action_low=-1.0,
            action_high=1.0,
        ),
    )


def scores_of(algorithm: str, data: Path, make_world: Any, budget: Budget) -> Estimate:
    """Trains on a converted dataset and plays in their world: mean score and interval."""
    dataset = swarmdata.load(str(data), progress=False)
    assert isinstance(dataset.spec, swarmdata.RecordedSpec)
    seeds = swarmdata.foreign_evaluation_seeds(budget.n_episodes)
    with tempfile.TemporaryDirectory() as run:
        policies = train(algorithm, dataset, Path(run), budget)
    returns = [
        swarmdata.evaluate_parallel(policy, make_world, dataset.spec, seeds).metrics["return"]
        for policy in policies
    ]
    return mean_interval(normalized(np.stack(returns)))


def train(
    algorithm: str, dataset: swarmdata.Dataset, run: Path, budget: Budget
) -> Sequence[swarmdata.Policy]:
    """Trains all seeds together on the train split."""
    return train_seeds(
        algorithm, dataset.split("train"), run, seeds=range(budget.n_seeds),
        config=our_config(algorithm, budget), progress=False,
    )  # fmt: skip


def text(rows: Sequence[tuple[str, ...]], kinds: Sequence[str], budget: Budget) -> str:
    """The table, with the paper's rows below ours."""
    published = [
        (f"published: {name}", *(f"{row[KINDS.index(kind)]:.1f}" for kind in kinds))
        for name, row in PAPER.items()
    ]
    return (
        f"Scores on OMAR's data of cooperative navigation ({RANDOM} is 0, {EXPERT} is 100), played "
        f"in its world: {budget.n_updates:,} updates of {budget.batch_size}, two hidden layers of "
        f"{budget.units}, {budget.n_seeds} seeds, {budget.n_episodes} episodes of {STEPS} steps. "
        "One setting for all kinds. Published: MADiff (2024), table 1, after OMAR (2022).\n\n"
        + table(("learner", *kinds), [*rows, *published])
    )


def parsed() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser()
    for key, meaning in {"data": "its datasets", "omar": "checkout of ling-pan/OMAR"}.items():
        named = os.environ.get({"data": "OMAR_DATA", "omar": "OMAR"}[key])
        default = Path(named) if named else None
        parser.add_argument(f"--{key}", type=Path, default=default, help=meaning)
    parser.add_argument("--algorithms", nargs="+", default=("bc", "maddpg_bc", "omar"))
    parser.add_argument("--updates", type=int, default=8000)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--units", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=100)
    return parser.parse_args()


def measure(data: Path, omar: Path, algorithms: Sequence[str], budget: Budget) -> str:
    """Converts, trains and plays; returns the table of the kinds that are there.

    Args:
        data: folder with `simple_spread`.
        omar: checkout.
        algorithms: ours.
        budget: of each.

    Raises:
        FileNotFoundError: there is no dataset of cooperative navigation.
    """
    source = data / "simple_spread"
    kinds = [kind for kind in KINDS if (source / kind).is_dir()]
    if not kinds:
        raise FileNotFoundError(f"{source} has none of the folders {', '.join(KINDS)}")
    cells: dict[str, list[str]] = {name: [] for name in ("recorded episodes", *algorithms)}
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            out = Path(folder) / kind
            dataset = convert(source / kind, kind, out)
            recorded = float(normalized(dataset.episodes.team_return.mean()))
            cells["recorded episodes"].append(f"{recorded:.1f}")
            for name in algorithms:
                estimate = scores_of(name, out, partial(ParticleWorld, omar), budget)
                cells[name].append(shown(estimate))
                print(f"{kind}, {name}: {cells[name][-1]}", flush=True)
    labels = {name: f"ours, `{name}`" for name in algorithms}
    rows = [(labels.get(name, name), *row) for name, row in cells.items()]
    return text(rows, kinds, budget)


def main() -> None:
    """Prints the table."""
    arguments = parsed()
    if arguments.data is None or arguments.omar is None:
        print("OMAR's data (--data) and code (--omar) are not given: its tables are not measured")
        return
    torch.set_num_threads(1)
    budget = Budget(
        arguments.updates, arguments.batch, arguments.units, arguments.seeds, arguments.episodes
    )
    print(measure(arguments.data, arguments.omar, arguments.algorithms, budget))


if __name__ == "__main__":
    main()
