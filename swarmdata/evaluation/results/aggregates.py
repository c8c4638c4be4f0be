"""Many runs on many datasets become a few numbers with intervals; pure functions of a result set.

The measures are those of Agarwal et al., "Deep Reinforcement Learning at the Edge of the
Statistical Precipice", NeurIPS 2021, which Gorsane et al., "Towards a Standardised Performance
Evaluation Protocol for Cooperative MARL", NeurIPS 2022, take over for teams: a run's score on a
dataset is the mean over its episodes, tables are [runs, datasets], and intervals are 95 %
percentile bootstraps that draw runs within each dataset.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.rollouts import score_statistics
from swarmdata.rollouts.score_statistics import Estimate, resample
from swarmdata.types import Bool, Double

N_RESAMPLES = 2000

LEVEL = 0.95


def generator_of(seed: int = 0) -> np.random.Generator:
    """The fixed source of resamples, so that a report is repeatable."""
    return np.random.Generator(np.random.PCG64(seed))


@dataclass(frozen=True, eq=False)
class Complete:
    """Labels that were measured on all datasets that have a score, equally often on each."""

    datasets: tuple[str, ...]
    tables: Mapping[str, Double]  # label -> mean scores [runs, datasets], in the labels' order
    left_out: Mapping[str, str]  # label or dataset -> why it is not in the tables


def complete(results: ResultSet, datasets: Sequence[str] | None = None) -> Complete:
    """Picks what aggregates can compare: a mean over other datasets is another quantity.

    Args:
        results: what was measured.
        datasets: to aggregate over; None: all that have a score.

    Raises:
        UnknownNameError: nothing was measured on one of them.
    """
    cases = results.cases if datasets is None else [results.case(name) for name in datasets]
    names = tuple(case.name for case in cases if case.reference is not None)
    left_out = {
        case.name: "no references were measured in its world"
        for case in cases
        if case.reference is None
    }
    tables = {}
    for label in results.labels if names else ():
        found = results.scores[label]
        absent = [name for name in names if name not in found]
        counts = {len(found[name]) for name in names if name in found}
        if absent:
            left_out[label] = f"not measured on {', '.join(absent)}"
        elif len(counts) > 1:
            left_out[label] = f"has between {min(counts)} and {max(counts)} runs on a dataset"
        else:
            tables[label] = np.stack([found[name].mean(axis=1) for name in names], axis=1)
    return Complete(names, tables, left_out)


class Aggregate(NamedTuple):
    """One label over all datasets."""

    n_runs: int
    iqm: Estimate  # interquartile mean of the score, section 4.3
    mean: Estimate
    optimality_gap: Estimate  # how far runs stay below 100, on average, section 4.3


def aggregates(
    tables: Mapping[str, Double], *, n_resamples: int = N_RESAMPLES
) -> dict[str, Aggregate]:
    """Aggregates of each label.

    Args:
        tables: label -> scores [runs, datasets], such as `Complete.tables`.
        n_resamples: of each bootstrap.
    """

    def estimate(statistic: Callable[..., Double], table: Double) -> Estimate:
        return score_statistics.bootstrap(
            statistic, table, generator=generator_of(), n_resamples=n_resamples
        )

    return {
        label: Aggregate(
            len(table),
            estimate(score_statistics.iqm, table),
            estimate(score_statistics.mean, table),
            estimate(score_statistics.optimality_gap, table),
        )
        for label, table in tables.items()
    }


def performance_profile(scores: Double, thresholds: Double) -> Double:
    """Share of runs whose score is above each threshold: `scores[..., runs, tasks] -> [..., P]`.

    F(tau) = 1/M sum_m 1/N sum_n 1[x_mn > tau], the score distribution of section 4.2.
    """
    above = scores[..., None] > thresholds
    return np.asarray(above.mean(axis=(-3, -2)))


class Band(NamedTuple):
    """A curve and the ends of its pointwise interval, [P] each."""

    value: Double
    low: Double
    high: Double


def profile_band(
    scores: Double,
    thresholds: Double,
    *,
    generator: np.random.Generator | None = None,
    n_resamples: int = N_RESAMPLES,
    level: float = LEVEL,
) -> Band:
    """The performance profile of one label with its stratified bootstrap interval.

    Args:
        scores: [runs, tasks].
        thresholds: increasing, [P].
        generator: source of the resamples; the fixed one by default.
        n_resamples: how many.
        level: probability that the interval is to cover at each threshold.
    """
    rng = generator_of() if generator is None else generator
    size = max(1, score_statistics.MAX_RESAMPLED_SCORES // (scores.size * len(thresholds)))
    counts = [min(size, n_resamples - start) for start in range(0, n_resamples, size)]
    draws = [performance_profile(resample(scores, rng, n), thresholds) for n in counts]
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(np.concatenate(draws), [tail, 1.0 - tail], axis=0)
    return Band(performance_profile(scores, thresholds), low, high)


def thresholds_of(tables: Mapping[str, Double], n: int = 301) -> Double:
    """Thresholds from the lowest score to the highest, at least from 0 to 100, [n].

    Raises:
        SchemaError: there are no tables.
    """
    if not tables:
        raise SchemaError("there are no scores to draw a profile of, expected at least one label.")
    low = min(float(table.min()) for table in tables.values())
    high = max(float(table.max()) for table in tables.values())
    return np.linspace(min(low, 0.0) - 1.0, max(high, 100.0) + 1.0, n)


def improvements(
    tables: Mapping[str, Double], *, n_resamples: int = N_RESAMPLES
) -> dict[tuple[str, str], Estimate]:
    """Probability that a run of one label beats one of another on a random dataset.

    Mann-Whitney's U over runs_x runs_y, ties one half, averaged over datasets (section 4.3).

    Args:
        tables: label -> scores [runs, datasets].
        n_resamples: of each bootstrap, which draws both labels.

    Returns:
        (label, other) -> P(label > other), of all pairs of different labels.
    """
    return {
        (one, other): score_statistics.bootstrap(
            score_statistics.probability_of_improvement,
            tables[one],
            tables[other],
            generator=generator_of(),
            n_resamples=n_resamples,
        )
        for one in tables
        for other in tables
        if one != other
    }


def mean_over_runs(
    values: Double,
    *,
    n_resamples: int = N_RESAMPLES,
    statistic: Callable[..., Double] | None = None,
) -> Estimate:
    """One label on one dataset: the interquartile mean over runs with its interval.

    Of a single run it is the mean over episodes, with an interval over episodes.

    Args:
        values: [runs, episodes].
        n_resamples: of the bootstrap.
        statistic: of the table [runs, 1]; the interquartile mean by default.
    """
    if len(values) > 1:
        table, chosen = values.mean(axis=1)[:, None], statistic or score_statistics.iqm
    else:
        table, chosen = values.T, score_statistics.mean
    return score_statistics.bootstrap(
        chosen, table, generator=generator_of(), n_resamples=n_resamples
    )


def pareto_front(values: Sequence[float], costs: Sequence[float]) -> Bool:
    """Which points no other beats: none has at least the value at no more cost, and one of both.

    Args:
        values: to be high, [n].
        costs: to be low, [n].
    """
    value, cost = np.asarray(values, np.float64), np.asarray(costs, np.float64)
    as_good = (value[None, :] >= value[:, None]) & (cost[None, :] <= cost[:, None])  # [n, other]
    better = (value[None, :] > value[:, None]) | (cost[None, :] < cost[:, None])
    return np.asarray(~(as_good & better).any(axis=1))


class Point(NamedTuple):
    """A label between what it earns and what it hits, on one dataset."""

    label: str
    team_return: Estimate
    collisions: Estimate  # contacts that began, with robots and with obstacles, per episode
    is_best: bool  # on the Pareto front of its dataset


def pareto(case: Case) -> tuple[Point, ...]:
    """Return against collisions of every label of a case, in its order.

    Raises:
        UnknownNameError: an environment that counts no collisions.
    """
    gains = [mean_over_runs(case.metric(label, "return")) for label in case.runs]
    costs = [mean_over_runs(collisions(case, label)) for label in case.runs]
    front = pareto_front([each.value for each in gains], [each.value for each in costs])
    return tuple(map(Point, case.runs, gains, costs, front.tolist()))


def collisions(case: Case, label: str) -> Double:
    """Contacts that began in each episode, of both kinds, [runs, episodes]."""
    between, against = "robot_collisions", "obstacle_collisions"
    return np.asarray(case.metric(label, between) + case.metric(label, against))
