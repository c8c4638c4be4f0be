"""Records MPE2's simple_spread_v3, trains MADDPG+BC on the recording, and plays the result.

    python tests/examples/record_simple_spread.py FOLDER

writes the dataset FOLDER/simple_spread_v3-mixed-v0 and the training run FOLDER/run, and prints the
returns of random actions, of the recorded policies and of the learned ones. It needs mpe2 and
torch.
"""

import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import swarmdata

ID = "simple_spread_v3-mixed-v0"
OPTIONS = {"continuous_actions": True, "max_cycles": 25}
GAINS = {"careful": 1.0, "hasty": 6.0}
"""How hard each recorded policy pushes towards its landmark; it ignores the other agents."""


def make_env() -> Any:
    """Makes the environment: three agents that should cover three landmarks."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # pygame, without a window
    from mpe2 import simple_spread_v3

    with warnings.catch_warnings():  # PettingZoo deprecates this way to make environments
        warnings.simplefilter("ignore", DeprecationWarning)
        return simple_spread_v3.parallel_env(**OPTIONS)


def drive(index: int, observation: Any, gain: float, noise: Any) -> Any:
    """Pushes agent `index` towards the landmark with the same index.

    An observation begins with the agent's velocity, its position, and the displacements of the
    landmarks; an action has five components, no-op, left, right, down and up, each from 0 to 1.
    """
    velocity, displacement = observation[0:2], observation[4 + 2 * index : 6 + 2 * index]
    right, up = np.clip(gain * displacement - velocity + noise, -1, 1)
    return np.array([0, max(-right, 0), max(right, 0), max(-up, 0), max(up, 0)], dtype=np.float32)


def record(path: Path, n_episodes: int = 200) -> swarmdata.Dataset:
    """Records two noisy scripted policies, which take turns by episode."""
    rng = np.random.default_rng(0)
    recorder = swarmdata.Recorder(
        make_env(),
        id=ID,
        path=path,
        policies=tuple(GAINS),
        options=OPTIONS,
        metadata={
            "author": "swarmdata's examples",
            "license": "cc-by-4.0",
            "description": "Two scripted policies with noise in MPE2's simple_spread_v3.",
            "code": "tests/examples/record_simple_spread.py",
        },
    )
    with recorder:
        while (k := recorder.n_episodes) < n_episodes:  # those of a run that was killed count
            label = tuple(GAINS)[k % len(GAINS)]
            observations, _ = recorder.reset(policy=label)
            while recorder.agents:
                actions = {
                    agent: drive(
                        int(agent[-1]), observations[agent], GAINS[label], rng.normal(0, 0.3, 2)
                    )
                    for agent in recorder.agents
                }
                observations, *_ = recorder.step(actions)
    return recorder.close()


def train(dataset: Path | str, run: Path, n_updates: int = 1500) -> list[swarmdata.Policy]:
    """Trains two seeds of MADDPG+BC on the train split; the dataset is an id or a folder."""
    changes = {"n_updates": str(n_updates)}
    options: dict[str, Any] = {"n_seeds": 2, "changes": changes, "progress": False}
    return swarmdata.train("maddpg_bc", str(dataset), run, **options)


def spec_of(dataset: swarmdata.Dataset) -> swarmdata.RecordedSpec:
    """The spec of the recorded environment."""
    assert isinstance(dataset.spec, swarmdata.RecordedSpec)
    return dataset.spec


def play(
    policies: Sequence[swarmdata.Policy], spec: swarmdata.RecordedSpec, n_episodes: int = 30
) -> list[float]:
    """Mean return of each policy in the environment, on the seeds reserved for evaluation."""
    seeds = swarmdata.foreign_evaluation_seeds(n_episodes)
    results = [swarmdata.evaluate_parallel(policy, make_env, spec, seeds) for policy in policies]
    return [float(result.metrics["return"].mean()) for result in results]


def play_random(n_episodes: int = 30) -> float:
    """Mean return of random actions on the same seeds."""
    env, returns = make_env(), []
    for k, seed in enumerate(swarmdata.foreign_evaluation_seeds(n_episodes)):
        env.reset(seed=int(seed))
        for agent in env.possible_agents:
            env.action_space(agent).seed(k)
        returns.append(0.0)
        while env.agents:
            actions = {agent: env.action_space(agent).sample() for agent in env.agents}
            returns[-1] += float(np.mean(list(env.step(actions)[1].values())))
    return float(np.mean(returns))


def main(folder: Path, n_episodes: int = 200, n_updates: int = 1500) -> dict[str, float]:
    """Records, trains and plays; prints and returns mean returns by name."""
    dataset = record(folder / ID, n_episodes)
    returns = {"random actions": play_random()}
    for label in GAINS:
        episodes = dataset.filter(policy=label).episodes
        returns[f"recorded: {label}"] = float(episodes.team_return.mean())
    policies = train(folder / ID, folder / "run", n_updates)
    for index, mean in enumerate(play(policies, spec_of(dataset))):
        returns[f"learned: seed {index}"] = mean
    print(dataset)
    for name, mean in returns.items():
        print(f"{name:20} {mean:8.2f}")
    return returns


if __name__ == "__main__":
    main(Path(sys.argv[1]))
