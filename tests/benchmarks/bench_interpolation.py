"""Policies between a clone and a policy of another algorithm, on validation episodes.

    swarmdata study cards/studies/regimes.yaml --only '*/search-medium'
    python -m tests.benchmarks.bench_interpolation iql search-medium --runs runs/study-regimes

Prints a row for each dataset: success in percent of policies that act by (1 - s) a + s b, with a
the command of the clone and b that of the other, for some shares s, and its 95 % interval over
training seeds and episodes.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import swarmdata
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.torch_policy import StepFunction
from swarmdata.learn.training.run_folder import load_run
from swarmdata.rollouts.score_intervals import rate_interval
from swarmdata.types import Float, Step
from tests.benchmarks.measuring import table

SHARES = (0.0, 0.1, 0.2, 0.5, 1.0)

N_EPISODES = 200
"""Of the validation seeds, for each training seed."""


@dataclass(frozen=True, slots=True, eq=False)
class Between(StepFunction):
    """Acts between the commands of two policies without memory."""

    clone: Policy
    other: Policy
    share: float  # of the other

    @property
    def uses_state(self) -> bool:
        return False

    def step_actions(self, step: Step) -> Float:
        start, end = self.clone.act(step), self.other.act(step)
        return start + np.float32(self.share) * (end - start)


def success_between(cells: Path, algorithm: str, dataset: str) -> list[str]:
    """Returns the success for each share, in percent with its interval."""
    spec = swarmdata.load(dataset).task
    clones, others = (load_run(cells / name / dataset / name) for name in ("bc", algorithm))
    found = []
    for share in SHARES:
        results = [
            swarmdata.evaluate(
                Between(clone, other, share), spec, n_episodes=N_EPISODES, block="validation",
                progress=False,
            )
            for clone, other in zip(clones, others, strict=True)
        ]  # fmt: skip
        estimate = rate_interval(np.array([each.metrics["success"] for each in results], float))
        mean, low, high = (100.0 * value for value in estimate)
        found.append(f"{mean:.1f} ({low:.1f} to {high:.1f})")
    return found


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("algorithm")
    parser.add_argument("datasets", nargs="+")
    parser.add_argument("--runs", type=Path, default=Path("runs/study-regimes"))
    options = parser.parse_args()
    rows = [
        (f"`{dataset}`", *success_between(options.runs / "cells", options.algorithm, dataset))
        for dataset in options.datasets
    ]
    print(table(("dataset", *(f"{share:g}" for share in SHARES)), rows))


if __name__ == "__main__":
    main()
