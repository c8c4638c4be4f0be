"""Whether values improve on a clone: its policy, moved towards another, into docs/measurements.md.

    swarmdata study cards/studies/regimes.yaml --only '*-medium-expert'
    python -m tests.benchmarks.bench_deviations --runs runs/study-regimes

In every step, the team takes the action of a clone of the data plus a part of the difference to the
action of another policy from the same data. The same difference in a random direction, fixed for
each robot and episode, tells what actions of that distance cost if they know nothing. An algorithm
whose values know what to change is better than the clone on its own side, and worse on the other.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import swarmdata
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.torch_policy import StepFunction
from swarmdata.learn.training.run_folder import load_run
from swarmdata.registry.published import normalized_score, references_of
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.score_intervals import combination_interval
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step
from tests.benchmarks.measuring import table, write_section

DATASETS = tuple(f"{t}-medium-expert" for t in ("coop_nav", "formation", "transport", "warehouse"))

CLONE, OTHERS = "bc", ("maddpg_bc", "iql", "filtered_bc")

N_EPISODES = 200
"""Of the validation seeds, for each training seed."""


class Way(NamedTuple):
    """How the team departs from the clone."""

    name: str
    part: float  # of the difference to the other policy
    is_turned: bool = False  # by a random angle for each robot of each episode


CLONED = Way("the clone", 0.0)

WAYS = (
    Way("half of the way", 0.5),
    Way("all of it", 1.0),
    Way("all, turned", 1.0, is_turned=True),
    Way("half, away", -0.5),
)


@cache
def angles(seed: int, n_agents: int) -> Double:
    """The angles of an episode's robots (rad), uniform over the circle, [N]."""
    return np.random.default_rng(seed).uniform(0.0, math.tau, n_agents)


def turned(vectors: Float, by: Double) -> Float:
    """Turns planar vectors [E, N, 2] by angles (rad) [E, N]."""
    x, y = vectors[..., 0], vectors[..., 1]
    cosine, sine = np.cos(by), np.sin(by)
    both = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
    return both.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Departing(StepFunction):
    """The clone plus a part of the difference to another policy; `lengths` has its size."""

    clone: Policy
    other: Policy
    way: Way
    lengths: list[float] = field(default_factory=list)  # mean over robots and copies, by step

    @property
    def uses_state(self) -> bool:
        return self.clone.uses_state or self.other.uses_state

    def reset(self, step: Step, copies: Int) -> None:
        self.clone.reset(step, copies)
        self.other.reset(step, copies)

    def step_actions(self, step: Step) -> Float:
        base = self.clone.act(step)
        difference = self.other.act(step) - base
        self.lengths.append(float(np.linalg.norm(difference, axis=-1).mean()))
        if self.way.is_turned:
            by = np.stack([angles(int(seed), base.shape[1]) for seed in step.seeds])
            difference = turned(difference, by)
        return np.clip(base + self.way.part * difference, -1.0, 1.0).astype(np.float32)


class Pair(NamedTuple):
    """A clone and another policy of one training seed."""

    clone: Policy
    other: Policy


def pairs_of(dataset_id: str, algorithm: str, runs: Path) -> list[Pair]:
    """The policies of a study's cells, seed by seed."""
    folders = [runs / "cells" / name / dataset_id / name for name in (CLONE, algorithm)]
    return [Pair(*policies) for policies in zip(*map(load_run, folders), strict=True)]


class Measured(NamedTuple):
    """What became of the pairs of all seeds in one way."""

    scores: Double  # [K, episodes]
    distance: float  # mean length of the differences


def measured(pairs: Sequence[Pair], spec: TaskSpec, way: Way, n_episodes: int) -> Measured:
    """Scores of each seed's team on the validation episodes."""
    known = references_of(spec.hash())
    reference = None if known is None else known.reference
    assert reference is not None, "every task has references"
    teams = [Departing(pair.clone, pair.other, way) for pair in pairs]
    results = [
        evaluate(
            team, spec, name=way.name, n_episodes=n_episodes, block="validation", progress=False
        )
        for team in teams
    ]
    returns = np.stack([result.metrics["return"] for result in results])
    distance = float(np.mean([np.mean(team.lengths) for team in teams]))
    return Measured(normalized_score(returns, reference), distance)


def measure(
    dataset_id: str, algorithm: str, runs: Path, n_episodes: int = N_EPISODES
) -> tuple[str, ...]:
    """The row of an algorithm: differences to the clone, paired by episode and seed."""
    pairs, spec = pairs_of(dataset_id, algorithm, runs), swarmdata.load(dataset_id).spec
    assert isinstance(spec, TaskSpec)
    base = measured(pairs, spec, CLONED, n_episodes)
    cells = [f"`{dataset_id}`", f"`{algorithm}`"]
    cells += [f"{base.distance:.2f}", f"{base.scores.mean():.1f}"]
    for way in WAYS:
        departed = measured(pairs, spec, way, n_episodes)
        value, low, high = combination_interval([departed.scores - base.scores], [1.0])
        cells.append(f"{value:+.1f} ({low:.1f} to {high:.1f})")
    return tuple(cells)


HEAD = ("data", "algorithm", "distance", CLONED.name, *(way.name for way in WAYS))

INTRO = f"""Scores of clones (`{CLONE}`) on {N_EPISODES} validation episodes, and what becomes of
them if in every step a part of the difference to another policy's action is added: half or all of
it, all of it turned by a random angle for each robot and episode, and half of it the other way.
Means over 5 seeds, with 95 % intervals over seeds and episodes. The distance is the mean length of
the differences where the clone goes, in commands of -1 to 1; policies are those of
[regimes](../cards/studies/regimes/report.md) (`python -m tests.benchmarks.bench_deviations`).
"""


def main() -> None:
    """Measures the datasets named on the command line, all by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--datasets", nargs="+", default=DATASETS)
    parser.add_argument("--runs", type=Path, default=Path("runs/study-regimes"))
    options = parser.parse_args()
    rows = []
    for dataset_id in options.datasets:
        for algorithm in OTHERS:
            rows.append(measure(dataset_id, algorithm, options.runs))
            print(" | ".join(rows[-1]), flush=True)
    write_section("What values change in a clone", f"{INTRO}\n{table(HEAD, rows)}")


if __name__ == "__main__":
    main()
