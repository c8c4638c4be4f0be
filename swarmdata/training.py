"""Trains an algorithm on a dataset of the catalog or in a task, as the command line does."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from swarmdata.catalog import load
from swarmdata.evaluate import evaluate
from swarmdata.interfaces import Policy
from swarmdata.learn.config import override
from swarmdata.learn.trainer import Schedule, train
from swarmdata.models import Source, with_models
from swarmdata.online_algos.mappo import Config as OnlineConfig
from swarmdata.presets import find_spec
from swarmdata.registry import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve
from swarmdata.spec import TaskSpec

CURVE_EPISODES = 64
"""Evaluation episodes of each point of a learning curve."""

CURVE_METRICS = ("return", "success", "clean_success")
"""What a learning curve holds, as means over its episodes."""


def train_offline(
    algorithm: str,
    dataset_id: str,
    out: Path,
    *,
    n_seeds: int = 3,
    changes: Mapping[str, str] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    curve_every: int = 1000,
    device: str = "cpu",
    progress: bool = True,
) -> list[Policy]:
    """Trains seeds 0, 1, ... at once on the train split; goes on where a run in `out` stopped.

    Args:
        algorithm: registered offline algorithm.
        dataset_id: of the catalog; built if it is not in the cache.
        out: the run's folder.
        n_seeds: how many.
        changes: settings of the algorithm as text.
        observation: trains on, and evaluates under, another model than the recorded one.
        communication: the same.
        curve_every: updates between two points of the learning curve.
        device: of torch.
        progress: whether to show bars.

    Raises:
        UnknownNameError: no such algorithm, dataset or setting.
        CheckpointError: `out` holds another run.
    """
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
    config = override(kind.Config(), changes or {})
    dataset = load(
        dataset_id, observation=observation, communication=communication, progress=progress
    ).split("train")
    spec = dataset.spec
    return train(
        algorithm,
        dataset,
        out,
        seeds=tuple(range(n_seeds)),
        config=config,
        schedule=Schedule(evaluate_every=curve_every),
        evaluate=lambda policy: _measure(policy, spec),
        device=device,
        progress=progress,
    )


def train_online(
    algorithm: str,
    task: str,
    out: Path,
    *,
    n_seeds: int = 3,
    changes: Mapping[str, str] | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
) -> None:
    """Trains seeds 0, 1, ... one after the other, each in its own folder `out/seed-<k>`.

    Args:
        algorithm: registered online algorithm.
        task: to train in: a preset's name, or a spec's file.
        out: folder of the runs.
        n_seeds: how many.
        changes: settings of the algorithm as text.
        observation: what the robots sense, if not what the task says.
        communication: what they hear, the same.

    Raises:
        UnknownNameError: no such algorithm, task or setting.
        BuildError: a folder holds another run.
    """
    run = resolve("algorithm", ONLINE_ALGORITHMS, algorithm)
    config = override(OnlineConfig(), changes or {})
    spec = with_models(find_spec(task), observation, communication)
    for seed in range(n_seeds):
        run(spec, config, seed, out / f"seed-{seed}")


def _measure(policy: Policy, spec: TaskSpec) -> dict[str, float]:
    result = evaluate(policy, spec, name="curve", n_episodes=CURVE_EPISODES, progress=False)
    return {name: float(np.mean(result.metrics[name])) for name in CURVE_METRICS}
