"""An algorithm of your own: trains on a dataset and writes results for `swarmdata report`.

    python tests/examples/own_algorithm.py coop_nav-medium-mini results
    swarmdata report results --out report

The algorithm is MARWIL (Wang et al. 2018): it imitates joint actions, with more weight on those
that did better than the value of their state. It uses public names of swarmdata only.
"""

import sys
from pathlib import Path

import torch

import swarmdata


def perceptron(inputs: int, outputs: int) -> torch.nn.Sequential:
    """Two hidden layers, in float64, so that evaluation does not depend on the batch size."""
    layers = torch.nn.Linear(inputs, 128), torch.nn.ReLU(), torch.nn.Linear(128, 128)
    return torch.nn.Sequential(*layers, torch.nn.ReLU(), torch.nn.Linear(128, outputs)).double()


def train(
    dataset: swarmdata.Dataset, seed: int, n_updates: int, beta: float = 2.0, discount: float = 0.95
) -> swarmdata.FunctionPolicy:
    """Trains one seed and returns its policy."""
    torch.manual_seed(seed)
    first = dataset[0]  # an episode: observations [T + 1, N, O], states [T + 1, S], ...
    actor = perceptron(first.observations.shape[2], first.actions.shape[2])
    value = perceptron(first.states.shape[1], 1)
    adam = torch.optim.Adam([*actor.parameters(), *value.parameters()], lr=1e-3)
    mean, std = map(torch.tensor, (dataset.statistics.observation_mean,
                                   dataset.statistics.observation_std))  # fmt: skip
    sampler = dataset.split("train").sampler(256, seed=seed)
    for _ in range(n_updates):
        batch = next(sampler).to_torch()
        v = value(batch.states.double())[:, 0]  # [B]
        with torch.no_grad():  # a truncation does not stop the bootstrap, a termination does
            v_next = value(batch.next_states.double())[:, 0]
            target = batch.rewards.mean(1) + discount * ~batch.terminations * v_next
            advantage = (target - v) / (target - v).std()
            weight = (beta * advantage).exp().clamp(max=20.0)
        pi = actor((batch.observations.double() - mean) / std).tanh()  # [B, N, A]
        cloning = weight * (pi - batch.actions).square().mean((1, 2))
        adam.zero_grad()
        (cloning + (v - target).square()).mean().backward()
        adam.step()

    @torch.no_grad()
    def act(observations: object) -> torch.Tensor:  # [E, N, O] to [E, N, A], E copies
        rows = torch.as_tensor(observations, dtype=torch.float64)
        return actor((rows - mean) / std).tanh()

    return swarmdata.FunctionPolicy(act)


def main(
    dataset_id: str, out: Path, n_seeds: int = 3, n_updates: int = 3000, n_episodes: int = 1000
) -> list[Path]:
    """Trains, evaluates on the reserved seeds, and writes a result file for each seed."""
    dataset, files = swarmdata.load(dataset_id), []
    for seed in range(n_seeds):
        policy = train(dataset, seed, n_updates)
        result = swarmdata.evaluate(policy, dataset.task, name="mine", n_episodes=n_episodes)
        means = {name: result.metrics[name].mean() for name in ("return", "success")}
        print(f"seed {seed}: return {means['return']:.2f}, success {means['success']:.2f}")
        provenance = swarmdata.Provenance(
            label="mine", index=seed, seed=seed, algorithm="mine", updates=n_updates,
            dataset=dataset.id, digest=dataset.digest,
        )  # fmt: skip
        measured = swarmdata.Result(result, provenance, dataset.task)
        files.append(swarmdata.save_result(measured, out))
    return files


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
