"""Aggregates of scores over runs and datasets.

After Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
NeurIPS 2021, and Gorsane et al., "Towards a Standardised Performance Evaluation Protocol for
Cooperative MARL", NeurIPS 2022.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.rollouts.score_intervals import AT_LEAST_ZERO, combination_interval, mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Bool, Double


@dataclass(frozen=True, eq=False)
class ComparableScores:
    """Scores of the labels that have equally many runs on all datasets with a score."""

    datasets: tuple[str, ...]
    tables: Mapping[str, Double]  # label -> scores [runs, datasets, episodes], in the labels' order
    left_out: Mapping[str, str]  # label or dataset -> why it is not in the tables


def comparable_scores(results: ResultSet) -> ComparableScores:
    """Selects the labels that aggregates can compare: those with results on all datasets.

    Datasets without a score are left out.
    """
    names = tuple(case.name for case in results.cases if case.reference is not None)
    without = (case.name for case in results.cases if case.reference is None)
    left_out = dict.fromkeys(without, "no references were measured in its world")
    tables = {}
    for label in results.labels if names else ():
        found = results.scores[label]
        counts = {len(found[name]) for name in names if name in found}
        if absent := [name for name in names if name not in found]:
            few = ", ".join(absent) if len(absent) <= 3 else f"{len(absent)} of them"
            left_out[label] = f"not measured on {few}"
        elif len(counts) > 1:
            left_out[label] = f"has between {min(counts)} and {max(counts)} runs on a dataset"
        else:
            tables[label] = np.stack([found[name] for name in names], axis=1)
    return ComparableScores(names, tables, left_out)


def mean_over_datasets(table: Double, other: Double | None = None) -> Estimate:
    """The mean of scores [runs, datasets, episodes] over datasets, or a difference of two of them.

    The datasets are fixed: the interval is for new training seeds and episodes on these datasets.
    """
    n = table.shape[1]
    found, weights = list(table.swapaxes(0, 1)), [1.0 / n] * n
    if other is not None:
        found += list(other.swapaxes(0, 1))
        weights += [-1.0 / n] * n
    return combination_interval(found, weights)


def optimality_gap(scores: Double) -> float:
    """The average shortfall of runs below 100; scores are [runs, datasets].

    100 - mean(min(score, 100)) (Agarwal et al. 2021, section 4.3).
    """
    return float(100.0 - np.minimum(scores, 100.0).mean())


def probability_of_improvement(ours: Double, theirs: Double) -> float:
    """The mean over datasets of the share of pairs of runs in which ours is above theirs, 0 to 1.

    Scores are [runs, datasets]; equal ones count half (Agarwal et al. 2021, section 4.3).
    """
    one, other = ours[:, None], theirs[None]  # [our runs, their runs, datasets]
    return float(((one > other) + 0.5 * (one == other)).mean())


def performance_profile(scores: Double, thresholds: Double) -> Double:
    """Share of the measured runs [runs, datasets] above each threshold [P], from 0 to 1, [P].

    F(tau) = 1/M sum_m 1/N sum_n 1[x_mn > tau], the score distribution of section 4.2.
    """
    return np.asarray((scores[..., None] > thresholds).mean(axis=(0, 1)))


def thresholds_of(tables: Mapping[str, Double]) -> Double:
    """Thresholds from the lowest score to the highest, and at least from 0 to 100, [301]."""
    low = min(float(table.min()) for table in tables.values())
    high = max(float(table.max()) for table in tables.values())
    return np.linspace(min(low, 0.0) - 1.0, max(high, 100.0) + 1.0, 301)


def differences(tables: Mapping[str, Double]) -> dict[tuple[str, str], Estimate]:
    """Mean score of one label minus that of another over the datasets, paired by episode.

    Scores are [runs, datasets, episodes]. The keys are all pairs (label, other) of different ones.
    """
    return {
        (one, other): mean_over_datasets(tables[one], tables[other])
        for one in tables
        for other in tables
        if one != other
    }


def pareto_front(values: Sequence[float], costs: Sequence[float]) -> Bool:
    """Returns which points [n] are Pareto-optimal: no other has as much value at no more cost."""
    value, cost = np.asarray(values, np.float64), np.asarray(costs, np.float64)
    as_good = (value[None, :] >= value[:, None]) & (cost[None, :] <= cost[:, None])  # [n, other]
    better = (value[None, :] > value[:, None]) | (cost[None, :] < cost[:, None])
    return np.asarray(~(as_good & better).any(axis=1))


def collisions_and_returns(case: Case) -> dict[str, tuple[Estimate, Estimate]]:
    """Label -> collisions and return per episode, in the order of a case."""
    return {
        label: (
            mean_interval(collisions(case, label), bounds=AT_LEAST_ZERO),
            mean_interval(case.metric(label, "return")),
        )
        for label in case.runs
    }


def collisions(case: Case, label: str) -> Double:
    """New contacts with robots and with obstacles, [runs, episodes]."""
    between, against = "robot_collisions", "obstacle_collisions"
    return np.asarray(case.metric(label, between) + case.metric(label, against))
