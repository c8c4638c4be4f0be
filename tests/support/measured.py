"""Results as if they had been measured, for tests of what is made of them."""

import csv
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.presets import preset
from swarmdata.registry.published import Interval, TaskReferences, published, side_specs
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.origins import RecordedAgent, RecordedSpec, SideSpec
from swarmdata.specs.spaces import BoxSpace
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult

COOP_NAV = preset("coop_nav")
MEDIUM, EXPERT = "coop_nav-medium-v1", "coop_nav-expert-v1"


MEANS = {"bc": {MEDIUM: 1.0, EXPERT: 5.0}, "omar": {MEDIUM: 2.0, EXPERT: 6.0}}
"""Of returns, as `grid` takes them."""


def at(value: float, half: float = 3.0) -> Estimate:
    """An estimate with a symmetric interval."""
    return Estimate(value, value - half, value + half)


def csv_rows(text: str) -> list[dict[str, str]]:
    """The rows of a CSV table."""
    return list(csv.DictReader(io.StringIO(text)))


def evaluation(
    label: str, spec: TaskSpec = COOP_NAV, *, mean: float = 2.0, n: int = 20, seed: int = 0
) -> EvalResult:
    """Random metrics whose return has about a mean; every fourth episode is not solved."""
    rng = np.random.default_rng([seed, len(label)])
    values = {name: rng.random(n) for name in metrics_of(spec.task)}
    values["return"] = mean + rng.normal(size=n)
    values["success"] = (np.arange(n) % 4 > 0).astype(np.float64)
    values["clean_success"] = (np.arange(n) % 4 > 1).astype(np.float64)
    values["time_to_goal"] = np.where(values["success"] > 0, 6.0, np.nan)
    return EvalResult(label, spec.task, spec.hash(), evaluation_seeds(n), values)


def reference_specs(family: str) -> dict[str, TaskSpec | SideSpec]:
    """What the references of a preset are of, by their names: the task, or each of its sides."""
    spec = preset(family)
    sides = side_specs(spec).items()
    return {f"{family}-{side}": each for side, each in sides} if sides else {family: spec}


def references_at(spec_hash: str, **returns: float) -> TaskReferences:
    """References of a spec whose teams have these mean returns."""
    return TaskReferences(
        spec_hash=spec_hash,
        n_episodes=10,
        made_with={},
        policies={
            name: {"return": Interval(value=value, low=value, high=value)}
            for name, value in returns.items()
        },
    )


def result(
    label: str = "bc",
    dataset: str | None = MEDIUM,
    index: int = 0,
    *,
    spec: TaskSpec = COOP_NAV,
    mean: float = 2.0,
    n: int = 20,
    **changes: Any,
) -> Result:
    """A run on a published dataset, or without one a policy that learned from no data."""
    trained: Mapping[str, Any] = {}
    if dataset is not None:
        trained = {
            "algorithm": "bc",
            "dataset": dataset,
            "digest": published()[dataset].digest,
            "config": {"discount": 0.95},
            "seed": index,
            "updates": 1000,
        }
    return Result(
        evaluation(label, spec, mean=mean, n=n, seed=index),
        Provenance(**{"label": label, "index": index, **trained, **changes}),
        spec,
    )


def grid(means: Mapping[str, Mapping[str, float]], n_runs: int = 3, **changes: Any) -> list[Result]:
    """Several runs of each label on each dataset, with mean returns that differ by run."""
    return [
        result(label, dataset, index, mean=mean + 0.3 * index, **changes)
        for label, row in means.items()
        for dataset, mean in row.items()
        for index in range(n_runs)
    ]


def foreign(**metrics: list[float]) -> Result:
    """A result of two episodes in an environment that is not ours."""
    space = BoxSpace(shape=(1,), dtype="float32", low=(-1.0,), high=(1.0,))
    spec = RecordedSpec(
        task="counting_v1",
        agents=(RecordedAgent(name="a", observation=space, action=space),),
        state_size=1,
        state_from="observations",
    )
    values = {name: np.array(row) for name, row in metrics.items()}
    made = EvalResult("bc", spec.task, spec.hash(), np.arange(2, dtype=np.uint64), values)
    return Result(made, Provenance(label="bc", dataset="counting_v1-mine-v0"), spec)
