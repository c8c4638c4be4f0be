"""How often 95 % intervals cover the truth, by simulation, into docs/measurements.md.

    python -m tests.benchmarks.bench_intervals [--draws N]

An algorithm's score with training seed k on episode e is a constant, plus a part of the seed, a
part of the episode that all algorithms share, a part of the episode that all seeds of the
algorithm share, and the rest. A draw has new seeds and new episodes; an interval covers if it holds
the expected score, or the expected difference of two algorithms on the same episodes.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from swarmdata.rollouts.score_intervals import difference_interval, mean_interval, t_quantile
from swarmdata.types import Double
from tests.benchmarks.measuring import table, write_section

EPISODE_SD = 38.0
"""Standard deviation of scores over episodes. In `cards/studies/validation-medium` algorithms have
32 to 71, of whose square 60 to 77 % are common to their training seeds."""

N_RESAMPLES = 600
FAILING_SHARE, FAILURE = 0.1, 5.0
"""Share of seeds that fail, where some do, and by how many standard deviations."""


class Setting(NamedTuple):
    """How scores vary."""

    n_seeds: int
    n_episodes: int
    seed_sd: float
    shared_by_seeds: float = 0.4  # share of the variance over episodes, of one algorithm
    shared_by_all: float = 0.4  # share that all algorithms have in common
    has_failures: bool = False

    @property
    def truth(self) -> float:
        """The expected score."""
        return -FAILING_SHARE * FAILURE * self.seed_sd if self.has_failures else 0.0


SETTINGS = (
    *(Setting(k, 200, sd) for sd in (3.0, 1.0, 8.0) for k in (3, 5, 10)),
    *(Setting(k, 1000, sd) for sd in (3.0, 1.0, 8.0) for k in (3, 5)),
    *(Setting(k, 200, 3.0, has_failures=True) for k in (3, 5, 10)),
    *(Setting(k, 200, 3.0, shared_by_seeds=0.6) for k in (3, 5)),
)


def draw(setting: Setting, rng: np.random.Generator) -> tuple[Double, Double]:
    """Scores of two algorithms with the same expectation on the same episodes, [K, E] each."""
    k, e = setting.n_seeds, setting.n_episodes
    scale = EPISODE_SD * np.sqrt(
        [
            setting.shared_by_all,
            setting.shared_by_seeds - setting.shared_by_all,
            1.0 - setting.shared_by_seeds,
        ]
    )
    by_all = scale[0] * rng.normal(size=e)

    def scores() -> Double:
        seeds = rng.normal(0.0, setting.seed_sd, (k, 1))
        if setting.has_failures:
            seeds -= FAILURE * setting.seed_sd * (rng.random((k, 1)) < FAILING_SHARE)
        by_seeds = scale[1] * rng.normal(size=e)
        return by_all + by_seeds + scale[2] * rng.normal(size=(k, e)) + seeds

    return scores(), scores()


Ends = tuple[float, float]


def bootstrap_of_seeds(x: Double, y: Double | None, rng: np.random.Generator) -> Ends:
    """The percentile bootstrap of the mean over seeds, as earlier reports had it."""
    means = _resampled(x, rng) if y is None else _resampled(x, rng) - _resampled(y, rng)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _resampled(x: Double, rng: np.random.Generator) -> Double:
    rows = rng.integers(len(x), size=(N_RESAMPLES, len(x)))
    return np.asarray(x.mean(axis=1)[rows].mean(axis=1))


def t_of_seeds(x: Double, y: Double | None, rng: np.random.Generator) -> Ends:
    """Student's t of seed means; of two algorithms with pooled degrees of freedom."""
    sides = [x] if y is None else [x, y]
    value = x.mean() - (0.0 if y is None else y.mean())
    error = np.sqrt(sum(side.mean(axis=1).var(ddof=1) / len(side) for side in sides))
    half = t_quantile(0.975, sum(len(side) - 1 for side in sides)) * error
    return float(value - half), float(value + half)


def of_seeds_and_episodes(x: Double, y: Double | None, rng: np.random.Generator) -> Ends:
    """`rollouts.score_intervals`."""
    found = mean_interval(x) if y is None else difference_interval(x, y)
    return found.low, found.high


Method = Callable[[Double, Double | None, np.random.Generator], Ends]

METHODS: Mapping[str, Method] = {
    "bootstrap of seeds": bootstrap_of_seeds,
    "t of seeds": t_of_seeds,
    "seeds and episodes": of_seeds_and_episodes,
}


class Coverage(NamedTuple):
    """Of an interval in one setting."""

    mean: float  # share of draws whose interval covers
    mean_width: float
    difference: float  # the same for the difference of two algorithms
    difference_width: float


def coverage(setting: Setting, method: Method, n_draws: int, seed: int = 0) -> Coverage:
    """Measures one interval in one setting."""
    rng = np.random.Generator(np.random.PCG64(seed))
    resampling = np.random.Generator(np.random.PCG64(seed + 1))
    ends = np.empty((n_draws, 2, 2))
    for k in range(n_draws):
        x, y = draw(setting, rng)
        ends[k] = method(x, None, resampling), method(x, y, resampling)
    truths = np.array([setting.truth, 0.0])
    covered = ((ends[..., 0] <= truths) & (truths <= ends[..., 1])).mean(axis=0)
    widths = (ends[..., 1] - ends[..., 0]).mean(axis=0)
    return Coverage(float(covered[0]), float(widths[0]), float(covered[1]), float(widths[1]))


def rows(n_draws: int) -> Iterator[tuple[str, ...]]:
    """A row for each setting."""
    for setting in SETTINGS:
        found = [coverage(setting, method, n_draws) for method in METHODS.values()]
        means = (f"{100 * each.mean:.0f} ({each.mean_width:.1f})" for each in found)
        differences = (
            f"{100 * each.difference:.0f} ({each.difference_width:.1f})" for each in found
        )
        what = f"{setting.n_seeds} seeds, {setting.n_episodes:,} episodes"
        if setting.has_failures:
            what += f"; {100 * FAILING_SHARE:.0f} % of seeds fail"
        if setting.shared_by_seeds != setting.shared_by_all:
            what += "; seeds share more than algorithms"
        yield (what, f"{setting.seed_sd:g}", *means, *differences)


HEAD = (
    "measured", "sd of seeds",
    *(f"mean: {name}" for name in METHODS), *(f"difference: {name}" for name in METHODS),
)  # fmt: skip


def text(n_draws: int, found: list[tuple[str, ...]]) -> str:
    """The section of docs/measurements.md."""
    return (
        "Share of simulated studies, in percent, whose 95 % interval holds the expected score over "
        "new training seeds and new episodes, or the expected difference of two algorithms on the "
        "same episodes; in brackets the mean width. Reports use the column *seeds and episodes* "
        "([how](evaluation.md#what-an-interval-means)). Scores have a standard deviation of "
        f"{EPISODE_SD:g} over episodes, 40 % of its square shared by all policies. "
        f"{n_draws:,} draws each (`python -m tests.benchmarks.bench_intervals`).\n\n"
        + table(HEAD, found)
    )


def main() -> None:
    """Simulates, prints and writes the section."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=4000)
    parser.add_argument(
        "--only-print", action="store_true", help="leave docs/measurements.md alone"
    )
    arguments = parser.parse_args()
    body = text(arguments.draws, list(rows(arguments.draws)))
    print(body)
    if not arguments.only_print:
        write_section("Coverage of intervals", body)


if __name__ == "__main__":
    main()
