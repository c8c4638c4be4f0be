"""Scores of policies in the simulator, to judge criteria that do without it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.interfaces import Policy
from swarmdata.rollouts.evaluate import check_comparable, evaluate
from swarmdata.types import EvalResult

Unit = Literal["score", "return"]


@dataclass(frozen=True, slots=True)
class Scores:
    """Means over the same episodes."""

    values: Sequence[float | None]  # one per policy; None: not measured
    n_episodes: int
    unit: Unit  # the normalized score, or the return where the task has no references


def simulate(
    policies: Sequence[Policy], dataset: Dataset, n_episodes: int, *, progress: bool = True
) -> Scores:
    """Evaluates policies in the dataset's task on the first reserved seeds.

    Raises:
        SpecError: the dataset was recorded in another environment.
    """
    names = [f"policy {index} of {len(policies)}" for index in range(1, len(policies) + 1)]
    results = [
        evaluate(policy, dataset.task, name=name, n_episodes=n_episodes, progress=progress)
        for name, policy in zip(names, policies, strict=True)
    ]
    return _scores(results, dataset)


def read_scores(keys: Sequence[tuple[str | None, int]], dataset: Dataset, folder: Path) -> Scores:
    """Reads results of `evaluate --out` in the dataset's world and models.

    Args:
        keys: `run_hash` of each policy's run and its training seed; None instead of the hash for a
            policy without results.
        dataset: of their training.
        folder: with the result files.

    Raises:
        SchemaError: there are no results of these policies, or they have different episodes.
    """
    paths = sorted(folder.glob("*.json"))
    results = [result for result in map(load_result, paths) if result.spec == dataset.spec]
    known = {(r.provenance.content, r.provenance.seed): r.evaluation for r in results}
    chosen = [None if key[0] is None else known.get(key) for key in keys]
    if all(each is None for each in chosen):
        raise SchemaError(
            f"{folder} holds {len(paths)} results, {len(results)} of them in the world and models "
            "of the data, but none of the last checkpoints of these runs. Evaluate these first: "
            "swarmdata evaluate RUN... --out FOLDER."
        )
    return _scores(chosen, dataset)


def _scores(results: Sequence[EvalResult | None], dataset: Dataset) -> Scores:
    measured = [result for result in results if result is not None]
    check_comparable(measured)
    values = [None if each is None else _score(each, dataset) for each in results]
    unit: Unit = "return" if dataset.references is None else "score"
    return Scores(values, len(measured[0].seeds), unit)


def _score(result: EvalResult, dataset: Dataset) -> float:
    mean = float(result.metrics["return"].mean())
    return mean if dataset.references is None else float(dataset.normalized_score(mean))
