"""Our algorithms beside code that nobody here wrote, on the same inputs, into docs/measurements.md.

    python -m tests.benchmarks.bench_algorithms --corl CHECKOUT --omar CHECKOUT --og-marl CHECKOUT

The checkouts are those of tinkoff-ai/CORL, ling-pan/OMAR and instadeepai/og-marl; the environment
variables CORL, OMAR and OG_MARL name them too. A peer without a checkout is left out, and without
any nothing is measured. All learners get the same inputs, numbers of updates, batch sizes, hidden
units and seeds, and are played on the same validation episodes by our evaluator
(`peers/team_data.py`); everything else is as their authors set it, and as we do by default.

Only our seeds are trained together, so a large budget takes hours. Every finished seed is kept in
the folder `--out` and is not trained again; delete its file there to measure it again.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from swarmdata import Policy, evaluate
from swarmdata.learn.training.overrides import override
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.registry.published import normalized_score, references_of
from swarmdata.rollouts.score_intervals import difference_interval, mean_interval, target_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double
from tests.benchmarks.measuring import table, write_section
from tests.benchmarks.peers import corl, og_marl_cql, omar
from tests.benchmarks.peers.checkouts import commit_of
from tests.benchmarks.peers.team_data import Budget, TeamData

DATASETS = ("coop_nav-medium-replay", "coop_nav-medium")
METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions")
NETWORKS = ("hidden", "actor_hidden", "critic_hidden")
"""Settings of the sizes of networks."""

REPOSITORIES = {
    "corl": "tinkoff-ai/CORL",
    "omar": "ling-pan/OMAR",
    "og_marl": "instadeepai/og-marl",
}


class Peer(NamedTuple):
    """A learner that is not ours."""

    repository: str  # one of `REPOSITORIES`
    counterpart: str  # our algorithm
    train: Callable[[Path, TeamData, Budget, int], Policy]  # from a checkout, with a seed


PEERS = {
    "CORL TD3+BC, team as one agent": Peer(
        "corl", "maddpg_bc", partial(corl.joint, kind=corl.TD3_BC)
    ),
    "CORL TD3+BC, one per robot": Peer(
        "corl", "maddpg_bc", partial(corl.per_robot, kind=corl.TD3_BC)
    ),
    f"CORL TD3+BC, team as one agent, alpha {corl.LOW_ALPHA:g}": Peer(
        "corl", "maddpg_bc", partial(corl.joint, kind=corl.TD3_BC_LOW_ALPHA)
    ),
    f"CORL TD3+BC, one per robot, alpha {corl.LOW_ALPHA:g}": Peer(
        "corl", "maddpg_bc", partial(corl.per_robot, kind=corl.TD3_BC_LOW_ALPHA)
    ),
    "CORL IQL, team as one agent": Peer("corl", "iql", partial(corl.joint, kind=corl.IQL)),
    "OMAR": Peer("omar", "omar", omar.omar),
    f"OMAR, rewards times {omar.PARTICLE_SCALE:g}": Peer(
        "omar", "omar", partial(omar.omar, reward_scale=omar.PARTICLE_SCALE)
    ),
    "OG-MARL MADDPG+CQL": Peer("og_marl", "maddpg_cql", og_marl_cql.maddpg_cql),
}
"""By the name of their row."""

OURS = ("bc", "maddpg_bc", "iql", "omar", "maddpg_cql")


class Played(NamedTuple):
    """A learner's seeds on the same episodes."""

    metrics: Mapping[str, Double]  # of `METRICS`, each [K, E]
    seconds: float  # of processor time to train one seed


class Kept(NamedTuple):
    """Where finished seeds are kept."""

    folder: Path

    def path(self, name: str, seed: int) -> Path:
        """The file of one seed of a learner."""
        return self.folder / name.replace(" ", "_").replace(",", "") / f"seed-{seed}.npz"

    def read(self, name: str, budget: Budget) -> Played | None:
        """What was measured, None unless all seeds are there with as many episodes."""
        paths = [self.path(name, seed) for seed in range(budget.n_seeds)]
        if not all(self.has(name, seed, budget) for seed in range(budget.n_seeds)):
            return None
        files = [np.load(path) for path in paths]
        metrics = {metric: np.stack([file[metric] for file in files]) for metric in METRICS}
        return Played(metrics, float(np.mean([file["seconds"] for file in files])))

    def has(self, name: str, seed: int, budget: Budget) -> bool:
        """Whether a seed is there with as many episodes."""
        path = self.path(name, seed)
        if not path.exists():
            return False
        file = np.load(path)
        return {*METRICS} <= {*file} and len(file["return"]) == budget.n_episodes

    def write(self, name: str, seed: int, metrics: Mapping[str, Double], seconds: float) -> None:
        """Keeps one seed."""
        path = self.path(name, seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, Any] = {metric: metrics[metric] for metric in METRICS}
        np.savez(path, seconds=seconds, **arrays)


def play(data: TeamData, policy: Policy, name: str, budget: Budget) -> Mapping[str, Double]:
    """Metrics of a policy on the validation episodes, each [E]."""
    return evaluate(
        policy, data.spec, name=name, n_episodes=budget.n_episodes, block="validation",
        progress=False,
    ).metrics  # fmt: skip


def train_peer(name: str, checkout: Path, data: TeamData, budget: Budget, kept: Kept) -> None:
    """Trains and plays the seeds of a peer that are not kept yet."""
    for seed in range(budget.n_seeds):
        if kept.has(name, seed, budget):
            continue
        begin = time.process_time()
        policy = PEERS[name].train(checkout, data, budget, seed)
        seconds = time.process_time() - begin
        metrics = play(data, policy, name, budget)
        kept.write(name, seed, metrics, seconds)
        print(f"{data.id}, {name}, seed {seed}: {metrics['return'].mean():.2f}", flush=True)


def train_ours(name: str, data: TeamData, budget: Budget, kept: Kept) -> None:
    """Trains and plays all seeds of one of our algorithms, unless they are kept."""
    if all(kept.has(name, seed, budget) for seed in range(budget.n_seeds)):
        return
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        policies = train_seeds(
            name,
            data.train,
            folder,
            seeds=range(budget.n_seeds),
            config=our_config(name, budget),
            schedule=Schedule(
                checkpoint_every=budget.n_updates, log_every=min(100, budget.n_updates)
            ),
            frame=data.frame,
            progress=False,
        )
    seconds = (time.process_time() - begin) / budget.n_seeds
    for seed, policy in enumerate(policies):
        metrics = play(data, policy, name, budget)
        kept.write(name, seed, metrics, seconds)
        print(f"{data.id}, {name}, seed {seed}: {metrics['return'].mean():.2f}", flush=True)


def our_config(name: str, budget: Budget) -> object:
    """The defaults at a budget; a warm-up keeps its share of the updates."""
    config = resolve("algorithm", OFFLINE_ALGORITHMS, name).Config()
    changes = {"n_updates": str(budget.n_updates), "batch_size": str(budget.batch_size)}
    units = f"{budget.units},{budget.units}"
    changes |= {key: units for key in NETWORKS if hasattr(config, key)}
    if hasattr(config, "bc_warmup_updates"):
        share = config.bc_warmup_updates / config.n_updates
        changes["bc_warmup_updates"] = str(round(share * budget.n_updates))
    return override(config, changes)


def verdict(difference: Estimate) -> str:
    """Which of two learners is better, if the interval of the difference says so."""
    if difference.low > 0:
        return "ours"
    return "theirs" if difference.high < 0 else "—"


def rows_of(data: TeamData, kept: Kept, budget: Budget) -> list[tuple[str, ...]]:
    """A row for each learner whose seeds are all kept.

    Raises:
        ValueError: the task has no measured references, so there are no scores.
    """
    known = references_of(data.spec.hash())
    if known is None or known.reference is None:
        raise ValueError(f"{data.id}: no references were measured in its task, expected a preset")
    found = {name: kept.read(name, budget) for name in (*PEERS, *OURS)}
    scores = {
        name: normalized_score(played.metrics["return"], known.reference)
        for name, played in found.items()
        if played is not None
    }
    recorded = float(normalized_score(data.mean_return, known.reference))
    rows = [("recorded episodes", f"{recorded:.1f}", *("",) * (len(HEAD) - 2))]
    for name, values in scores.items():
        played = found[name]
        assert played is not None
        other = PEERS[name].counterpart if name in PEERS else None
        versus = ("", "", "")
        if other in scores:
            difference = difference_interval(scores[other], values)
            versus = (f"`{other}`", signed(difference), verdict(difference))
        shares = (f"{100 * played.metrics[key].mean():.0f} %" for key in METRICS[1:3])
        collisions = " / ".join(f"{played.metrics[key].mean():.2f}" for key in METRICS[3:])
        label = name if name in PEERS else f"ours, `{name}`"
        each = " ".join(f"{value:.0f}" for value in values.mean(axis=1))
        seconds = f"{played.seconds:.0f}"
        rows.append(
            (label, shown(mean_interval(values)), each, *shares, collisions, *versus, seconds)
        )
    return rows


def shown(estimate: Estimate) -> str:
    """A score with its interval."""
    return f"{estimate.value:.1f} ({estimate.low:.1f} to {estimate.high:.1f})"


def signed(estimate: Estimate) -> str:
    """A difference with its interval."""
    return f"{estimate.value:+.1f} ({estimate.low:+.1f} to {estimate.high:+.1f})"


HEAD = ("learner", "score", "its seeds", "success", "clean success", "collisions, robot / obstacle",
        "against",
        "ours minus it", "better", "CPU s a seed")  # fmt: skip


Tables = Mapping[str, Sequence[tuple[str, ...]]]
"""Rows by dataset."""


def text(budget: Budget, sources: Mapping[str, str], tables: Tables) -> str:
    """The section of docs/measurements.md."""
    measured = ", ".join(f"{REPOSITORIES[key]} ({commit})" for key, commit in sources.items())
    parts = [
        f"Offline algorithms beside those of {measured}: {budget.n_updates:,} updates of "
        f"{budget.batch_size} joint transitions, two hidden layers of {budget.units}, "
        f"{budget.n_seeds} seeds, {budget.n_episodes} validation episodes. All learners get the "
        "same normalized observations and actions in the robots' frame, the same rewards, and our "
        "evaluator; everything else is as their authors set it. A team as one agent sees at every "
        "robot what all robots observe. Critics of OG-MARL keep their 128 units, and its policy "
        "is recurrent. Intervals (95 %) are for "
        f"{target_of([budget.n_seeds])}; a learner is better if that of the difference, paired by "
        "episode, leaves out 0."
    ]
    for dataset, rows in tables.items():
        parts.append(f"`{dataset}`:\n\n{table(HEAD, list(rows)).rstrip()}")
    return "\n\n".join(parts)


def parsed() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser()
    for key, repository in REPOSITORIES.items():
        named = os.environ.get(key.upper())
        parser.add_argument(
            f"--{key.replace('_', '-')}", type=Path, default=Path(named) if named else None,
            help=f"checkout of {repository}",
        )  # fmt: skip
    parser.add_argument("--datasets", nargs="+", default=DATASETS)
    parser.add_argument("--peers", nargs="*", default=tuple(PEERS), choices=tuple(PEERS))
    parser.add_argument("--ours", nargs="*", default=OURS, choices=OURS)
    parser.add_argument("--updates", type=int, default=Budget.n_updates)
    parser.add_argument("--batch", type=int, default=Budget.batch_size)
    parser.add_argument("--units", type=int, default=Budget.units)
    parser.add_argument("--seeds", type=int, default=Budget.n_seeds)
    parser.add_argument("--episodes", type=int, default=Budget.n_episodes)
    parser.add_argument("--out", type=Path, default=Path("runs/bench_algorithms"))
    parser.add_argument("--only-kept", action="store_true", help="train nothing: finished seeds")
    parser.add_argument(
        "--only-print", action="store_true", help="leave docs/measurements.md alone"
    )
    return parser.parse_args()


def train(
    arguments: argparse.Namespace,
    checkouts: Mapping[str, Path],
    data: TeamData,
    budget: Budget,
    kept: Kept,
) -> None:
    """Trains and plays what is not kept yet on one dataset."""
    for name in arguments.peers:
        if PEERS[name].repository in checkouts:
            train_peer(name, checkouts[PEERS[name].repository], data, budget, kept)
    for name in arguments.ours:
        train_ours(name, data, budget, kept)


def main() -> None:
    """Measures what is not kept yet, and writes the section."""
    arguments = parsed()
    checkouts = {key: getattr(arguments, key) for key in REPOSITORIES if getattr(arguments, key)}
    if not checkouts:
        print(
            f"no checkout of {', '.join(REPOSITORIES.values())} is given "
            "(--corl, --omar, --og-marl): algorithms are not compared"
        )
        return
    torch.set_num_threads(1)
    budget = Budget(
        arguments.updates, arguments.batch, arguments.units, arguments.seeds, arguments.episodes
    )
    size = f"{budget.n_updates}x{budget.batch_size}x{budget.units}"
    tables = {}
    for dataset in arguments.datasets:
        data, kept = TeamData(dataset), Kept(arguments.out / size / dataset)
        if not arguments.only_kept:
            train(arguments, checkouts, data, budget, kept)
        tables[dataset] = rows_of(data, kept, budget)
    sources = {key: commit_of(path) for key, path in checkouts.items()}
    body = text(budget, sources, tables)
    print(body)
    if not arguments.only_print:
        write_section("Algorithms beside others", body)


if __name__ == "__main__":
    main()
