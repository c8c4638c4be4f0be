"""What critics know of actions: advantages beside recorded returns, into docs/measurements.md.

    python -m tests.benchmarks.bench_advantages [--datasets ID ...] --out runs/advantages

Critics of `maddpg_bc` learn the value of a clone of the data: the second stage, in which the policy
climbs them, has hardly begun. On episodes that they have not seen, each robot's advantage
Q_i(a) - Q_i(pi) of the recorded actions over the clone's is compared with how much more the robot
then earned than Q_i(pi), and with the slopes of Q, of which each of two critics has its own. Where
advantages say nothing about returns, following critics adds noise to a clone, and noise that both
critics agree on.

Every run is kept in the folder `--out`.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

import swarmdata
from swarmdata.evaluation.runs.train import train
from swarmdata.learn.networks.dataset_statistics import returns_to_go
from swarmdata.learn.training.run_folder import Loaded, load_last
from swarmdata.offline_algos.maddpg_bc import MADDPGBC
from swarmdata.types import Double, Episode, Int
from tests.benchmarks.measuring import table, write_section

DATASETS = tuple(
    f"{task}-{tier}"
    for task in ("coop_nav", "formation", "transport", "warehouse")
    for tier in ("medium-replay", "expert")
)

N_UPDATES, N_SEEDS, N_EPISODES = 4_500, 3, 200
"""Of each run; and the first episodes of the validation split."""

REST = 0.1
"""Of a truncated episode, the steps count from which at most this share of the return is missing:
discount to the power of the steps that follow."""

N_DRAWS = 400
"""Of episodes, for intervals."""


class Rows(NamedTuple):
    """Recorded steps of some episodes, and what robots earned from then on."""

    observations: Tensor  # [B, N, O], in the frame of the run
    actions: Tensor  # [B, N, A]
    states: Tensor  # [B, S]
    returns: Tensor  # [B, N], discounted own rewards in the critics' unit
    episodes: Double  # [B], number of the episode


class Known(NamedTuple):
    """What one seed's critics say of the rows."""

    values: Tensor  # Q_i(a), [B, N], mean of the two critics
    advantages: Tensor  # Q_i(a) - Q_i(pi), [B, N]
    surpluses: Tensor  # returns less Q_i(pi), [B, N]
    agreement: float  # mean cosine of the slopes of the two critics


def trained(dataset_id: str, folder: Path) -> Loaded:
    """Trains actors and critics on a dataset, or reads what was trained before."""
    sizes = dict.fromkeys(("actor_hidden", "critic_hidden"), "64,64")
    changes = {
        "n_updates": str(N_UPDATES), "batch_size": "128", "tau": "0.03",
        "extraction_share": "0.01", **sizes,
    }  # fmt: skip
    train(
        "maddpg_bc", dataset_id, folder, n_seeds=N_SEEDS, changes=changes, curve_every=N_UPDATES,
        progress=False,
    )  # fmt: skip
    return load_last(folder)


def steps_of(episode: Episode, discount: float) -> int:
    """The steps of an episode whose return is known: all if it ended, else all but the last."""
    n_steps = len(episode.rewards)
    if episode.terminations[-1]:
        return n_steps
    return max(n_steps - math.ceil(math.log(REST) / math.log(discount)), 0)


def rows_of(loaded: Loaded, algorithm: MADDPGBC, episodes: Sequence[Episode]) -> Rows:
    """The rows of some episodes, as critics see them."""
    frame, discount, parts = loaded.run.frame, algorithm.config.discount, []
    for number, episode in enumerate(episodes):
        n_steps = steps_of(episode, discount)
        observations, actions = episode.observations[:n_steps], episode.actions[:n_steps]
        own = episode.rewards.astype(np.float64)
        returns = algorithm.rewards.scale * returns_to_go(own, discount)[:n_steps]
        if frame is not None:
            actions = frame.recorded(observations, actions)
            observations = frame.inputs(observations)
        states, numbers = episode.states[:n_steps], np.full(n_steps, float(number))
        parts.append((observations, actions, states, returns, numbers))
    *arrays, numbers = map(np.concatenate, zip(*parts, strict=True))
    seen, taken, world, earned = (
        torch.from_numpy(np.ascontiguousarray(array)).float() for array in arrays
    )
    return Rows(seen, taken, world, earned, numbers)


def known_by(algorithm: MADDPGBC, rows: Rows) -> Iterator[Known]:
    """What each seed's critics say."""
    n_seeds = len(algorithm.generators)
    observations, actions, states, returns = (
        part.expand(n_seeds, *part.shape).contiguous() for part in rows[:4]
    )
    view = algorithm.critics.view(states, observations)
    taken = actions.clone().requires_grad_()
    q = algorithm.critics.q(view, taken)  # [K, 2, B, N]
    one, other = (torch.autograd.grad(q[:, j].sum(), taken, retain_graph=True)[0] for j in (0, 1))
    agreement = torch.nn.functional.cosine_similarity(one, other, dim=3).mean((1, 2))  # [K]
    with torch.no_grad():
        of_clone = algorithm.critics.q(view, algorithm.actor(observations)).mean(1)  # [K, B, N]
        values = q.mean(1)
        for k in range(n_seeds):
            surpluses = returns[k] - of_clone[k]
            advantages = values[k] - of_clone[k]
            yield Known(values[k], advantages, surpluses, float(agreement[k]))


def correlation(one: Double, other: Double) -> float:
    """Pearson's, of two arrays of one shape."""
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def row_of(dataset_id: str, rows: Rows, known: Sequence[Known]) -> tuple[str, ...]:
    """The row of a dataset: means over seeds, and an interval over episodes of the correlation."""
    values, advantages, surpluses = (
        np.stack([getattr(each, name).numpy() for each in known])
        for name in ("values", "advantages", "surpluses")
    )  # [K, B, N]
    returns = rows.returns.numpy()
    fits = np.mean([correlation(each, returns) for each in values])

    def told(steps: Int | slice) -> float:
        pairs = zip(advantages, surpluses, strict=True)
        return float(np.mean([correlation(a[steps], s[steps]) for a, s in pairs]))

    rng, numbers = np.random.default_rng(0), np.unique(rows.episodes)
    places = [np.flatnonzero(rows.episodes == number) for number in numbers]
    draws = [
        told(np.concatenate([places[e] for e in rng.integers(len(places), size=len(places))]))
        for _ in range(N_DRAWS)
    ]
    low, high = np.quantile(draws, (0.025, 0.975))
    return (
        f"`{dataset_id}`",
        f"{fits:.2f}",
        f"{told(slice(None)):.2f} ({low:.2f} to {high:.2f})",
        f"{advantages.std():.3f}",
        f"{surpluses.std():.2f}",
        f"{np.mean([each.agreement for each in known]):.2f}",
    )


HEAD = (
    "data", "values and returns", "advantages and surplus returns", "deviation of advantages",
    "of surplus returns", "slopes of two critics",
)  # fmt: skip

INTRO = f"""Critics of `maddpg_bc` that value a clone of the data ({N_UPDATES:,} updates of 128
joint transitions, hidden layers of 64 units, {N_SEEDS} seeds), on the first {N_EPISODES} episodes
of the validation split. Correlations of Q(a) with the discounted return of the robot, and of the
advantage Q(a) - Q(pi) of the recorded action over the clone's with the return beyond Q(pi), with
95 % intervals over episodes (bootstrap); their deviations, in deviations of the returns-to-go; and
the mean cosine of the slopes of both critics in the recorded action. Of truncated episodes, steps
count whose return misses at most a tenth (`python -m tests.benchmarks.bench_advantages`).
"""


def measure(dataset_id: str, folder: Path, n_episodes: int = N_EPISODES) -> tuple[str, ...]:
    """Trains on a dataset, and returns its row of the table."""
    loaded = trained(dataset_id, folder / Path(dataset_id).name)
    algorithm = loaded.algorithm
    assert isinstance(algorithm, MADDPGBC)
    split = swarmdata.load(dataset_id).split("validation")
    episodes = [split[k] for k in range(min(n_episodes, len(split)))]
    rows = rows_of(loaded, algorithm, episodes)
    return row_of(dataset_id, rows, list(known_by(algorithm, rows)))


def main() -> None:
    """Measures the datasets named on the command line, all by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--datasets", nargs="+", default=DATASETS)
    parser.add_argument("--out", type=Path, default=Path("runs/advantages"))
    options = parser.parse_args()
    rows = []
    for dataset_id in options.datasets:
        rows.append(measure(dataset_id, options.out))
        print(" | ".join(rows[-1]), flush=True)
    write_section("What critics know of actions", f"{INTRO}\n{table(HEAD, rows)}")


if __name__ == "__main__":
    main()
