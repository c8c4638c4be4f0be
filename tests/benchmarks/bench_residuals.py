"""Does climbing the advantage of actions help on `transport`, and what misleads it?

    python -m tests.benchmarks.bench_residuals medium-1 medium-4 --seeds 2

One behavior policy of `transport-medium` acts with Gaussian noise, so how its action differs from
its mean is chance. Residual returns are regressed on residual actions (Robinson, 1988; the
R-learner of Nie and Wager, 2021): with the team's discounted return G, a baseline V of what all
robots observe, fitted to other episodes, and a mean action m(o),

    g = argmin E sum_i [G - V - g(o_i) . (a_i - m(o_i))]^2,

and robots act by m(o) + k g(o), with g scaled to a root mean square of 1. The mean is that of the
behavior policy itself, or of a clone. If g is an advantage, +k is better than -k. Prints scores on
300 validation episodes, and the difference, paired by episode.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

import swarmdata
from swarmdata.behavior_policies.checkpoint_files import read_checkpoint
from swarmdata.behavior_policies.exact_actor import forward, load_actor
from swarmdata.types import Double, Float
from tests.benchmarks.measuring import table

DATASET, DISCOUNT = "transport-medium", 0.97
STEPS = (0.0, 0.15, -0.15)
N_EPISODES = 300
CLONES = {"clone, 2 x 64, 9,000 updates": (64, 9_000), "clone, 2 x 256, 36,000": (256, 36_000)}
BEHAVIOR = "behavior policy"

Loss = Callable[[Tensor], Tensor]
Means = Callable[[Float], Float]


@dataclass(frozen=True, eq=False)
class Data:
    """Steps of one policy; observations and actions are in the world's frame."""

    observations: Float  # [n, N, O]
    actions: Float  # [n, N, A]
    returns: Tensor  # of the team, discounted, standardized, [n]
    episodes: Any  # number of each step's episode, int [n]
    encode: Callable[[Float], Tensor]  # to features in the robots' frames, [n, N, F]


def discounted(rewards: Float) -> Double:
    """The team's return from each step of an episode on, [T]."""
    total, found = 0.0, np.empty(len(rewards))
    for step in range(len(rewards) - 1, -1, -1):
        total = rewards[step].mean() + DISCOUNT * total
        found[step] = total
    return found


def read(dataset: Any) -> Data:
    """The steps of a dataset of one policy."""
    episodes = [dataset[k] for k in range(dataset.n_episodes)]
    observations = np.concatenate([each.observations[:-1] for each in episodes])
    returns = np.concatenate([discounted(each.rewards) for each in episodes])
    seen = dataset.frame.inputs(observations[::7])
    mean, std = seen.mean((0, 1)), seen.std((0, 1)).clip(1e-2)
    robots = np.eye(observations.shape[1], dtype=np.float32)

    def encode(observations: Float) -> Tensor:
        features = (dataset.frame.inputs(observations) - mean) / std
        index = np.broadcast_to(robots, (len(features), *robots.shape))
        return torch.from_numpy(np.concatenate([features, index], -1, dtype=np.float32))

    scaled = ((returns - returns.mean()) / returns.std()).astype(np.float32)
    numbers = np.repeat(np.arange(len(episodes)), [len(each.actions) for each in episodes])
    actions = np.concatenate([each.actions for each in episodes])
    return Data(observations, actions, torch.from_numpy(scaled), numbers, encode)


def network(n_inputs: int, n_outputs: int, hidden: int) -> nn.Sequential:
    """Two hidden layers."""
    return nn.Sequential(
        nn.Linear(n_inputs, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU(),
        nn.Linear(hidden, n_outputs),
    )  # fmt: skip


def fit(
    net: nn.Module, loss: Loss, rows: Any, rng: Any, n_updates: int, held_out: Any = None
) -> None:
    """Fits in place, to rows that are drawn from `rows`; keeps what is best on held-out rows."""
    adam = torch.optim.AdamW(net.parameters(), lr=1e-3, weight_decay=1e-3)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(adam, n_updates)
    best, kept = np.inf, net.state_dict()
    for update in range(1, n_updates + 1):
        value = loss(torch.from_numpy(rng.choice(rows, 256)))
        adam.zero_grad()
        value.backward()  # type: ignore[no-untyped-call]
        adam.step()
        decay.step()
        if held_out is not None and update % 500 == 0:
            with torch.no_grad():
                found = float(loss(torch.from_numpy(held_out)))
            if found < best:
                best, kept = found, {name: each.clone() for name, each in net.state_dict().items()}
    net.load_state_dict(kept)


def unexplained(data: Data, features: Tensor, rng: Any) -> Tensor:
    """Returns minus a baseline that was fitted to other episodes, standardized, [n]."""
    joint = features.reshape(len(features), -1)
    half, rows = rng.integers(0, 2, data.episodes[-1] + 1)[data.episodes], np.arange(len(joint))
    rest = data.returns.clone()
    for number in (0, 1):
        net, others = network(joint.shape[1], 1, 256), rows[half != number]

        def loss(i: Tensor, net: nn.Module = net) -> Tensor:
            return (net(joint[i])[:, 0] - data.returns[i]).square().mean()

        fit(net, loss, rows[half == number], rng, 6_000, others[::5])
        with torch.no_grad():
            for part in np.array_split(others, 20):
                rest[part] -= net(joint[part])[:, 0]
    return rest / rest.std()


def behavior_means(dataset: Any, label: str) -> Means:
    """Mean actions of the policy that recorded the data."""
    (source,) = (each for each in dataset.recipe.policies if each.label == label)
    data = read_checkpoint(source.checkpoint, source.sha256, None)
    actor = load_actor(data, dataset.spec.n_agents, source.checkpoint)
    return lambda observations: forward(actor, observations).astype(np.float32)


def clone_means(
    dataset: Any, data: Data, features: Tensor, rng: Any, size: tuple[int, int]
) -> Means:
    """Mean actions of a clone."""
    net = network(features.shape[-1], data.actions.shape[-1], size[0])
    actions = torch.from_numpy(dataset.frame.recorded(data.observations, data.actions))
    fit(net, lambda i: (net(features[i]).tanh() - actions[i]).square().mean(),
        np.arange(len(features)), rng, size[1])  # fmt: skip

    @torch.no_grad()
    def means(observations: Float) -> Float:
        return dataset.frame.to_world(observations, net(data.encode(observations)).tanh().numpy())

    return means


def advantage(
    dataset: Any, data: Data, features: Tensor, rest: Tensor, means: Means, rng: Any
) -> tuple[Means, float]:
    """The direction g in the world's frame, and the deviation of the residual actions."""
    parts = np.array_split(np.arange(len(features)), 20)
    expected = np.concatenate([means(data.observations[part]) for part in parts])
    residual = dataset.frame.to_local(data.observations, data.actions - expected)
    noise = torch.from_numpy(residual.astype(np.float32))
    net = network(features.shape[-1], noise.shape[-1], 64)
    held_out = rng.random(data.episodes[-1] + 1) < 0.2
    rows = np.arange(len(features))

    def loss(i: Tensor) -> Tensor:
        explained = 10.0 * (net(features[i]) * noise[i]).sum(-1)
        return (rest[i][:, None] - explained).square().mean()

    is_held_out = held_out[data.episodes]
    fit(net, loss, rows[~is_held_out], rng, 6_000, rows[is_held_out][::3])
    with torch.no_grad():
        scale = net(features[::11]).square().sum(-1).mean().sqrt().item()

    @torch.no_grad()
    def direction(observations: Float) -> Float:
        return dataset.frame.to_world(observations, net(data.encode(observations)).numpy() / scale)

    return direction, float(noise.std())


def scores(label: str, seed: int) -> Iterator[tuple[str, ...]]:
    """A row for each mean: the deviation of residual actions, and scores of the steps."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    dataset = swarmdata.load(DATASET).split("train").filter(policy=label)
    data = read(dataset)
    features = torch.cat([data.encode(each) for each in np.array_split(data.observations, 20)])
    rest = unexplained(data, features, rng)
    kinds = {BEHAVIOR: behavior_means(dataset, label)} | {
        name: clone_means(dataset, data, features, rng, size) for name, size in CLONES.items()
    }
    for name, means in kinds.items():
        direction, deviation = advantage(dataset, data, features, rest, means, rng)
        played = []
        for step in STEPS:

            def act(observations: Float, step: float = step) -> Float:
                return np.clip(means(observations) + step * direction(observations), -1, 1)  # noqa: B023

            found = swarmdata.evaluate(
                swarmdata.FunctionPolicy(act), dataset.task, n_episodes=N_EPISODES,
                block="validation", progress=False,
            )  # fmt: skip
            played.append(dataset.normalized_score(found.metrics["return"]))
        cells = [shown(each) for each in (*played, played[1] - played[2])]
        yield f"`{label}`, seed {seed}", name, f"{deviation:.3f}", *cells


def shown(values: Double) -> str:
    """A mean and half of its 95 % interval."""
    return f"{values.mean():.1f} ± {1.96 * values.std() / len(values) ** 0.5:.1f}"


def main() -> None:
    """Prints rows as they come, then the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("policies", nargs="+")
    parser.add_argument("--seeds", type=int, default=1)
    chosen = parser.parse_args()
    rows = []
    for seed in range(chosen.seeds):
        for label in chosen.policies:
            for row in scores(label, seed):
                print(*row, sep=" | ", flush=True)
                rows.append(row)
    head = (
        "data",
        "mean action",
        "deviation from it",
        *(f"k = {step}" for step in STEPS),
        "with - against",
    )
    print(table(head, rows))


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
