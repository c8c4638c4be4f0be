"""`train auto`: chooses an algorithm for a dataset by statistics of its episodes, without training.

1. Does some behavior policy solve most of its episodes, for certain? Then imitate it.
2. If so: are the best episodes by other policies than the rest? Then clone the best, else all.
3. If not: do the robots of a team share most of their return? Then a robot's own action explains
   little of it, and learned values mislead: clone the best episodes. Else learn values, and hold
   actions less to the data where this was measured to be safe.

`tests/benchmarks/fit_auto.py` fits the thresholds to the scores of the study `regimes`.
"""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture
from swarmdata.errors import SpecError
from swarmdata.rollouts.score_statistics import wilson_interval
from swarmdata.specs.origins import SideSpec
from swarmdata.types import Double, Int

_LOG = logging.getLogger("swarmdata")

AUTO = "auto"  # what `train` takes for the name of an algorithm, to choose one of `CANDIDATES`

CANDIDATES = ("bc", "filtered_bc", "iql", "maddpg_bc", "matd3")

BEST_SHARE = 0.1  # of the episodes: those that `filtered_bc` keeps

FEWEST_EPISODES = 300
"""Of a train split, below which chance moves the statistics far: its best tenth is 30 episodes."""


class Threshold(NamedTuple):
    """Where a statistic divides the datasets that were measured."""

    below: float  # the largest value of a dataset on the lower side
    above: float  # the smallest value of one on the upper side

    @property
    def middle(self) -> float:
        """The threshold."""
        return (self.below + self.above) / 2


THRESHOLDS = {
    "best_success": Threshold(0.50, 0.69),
    "best_shift": Threshold(0.18, 0.26),
    "common_reward": Threshold(0.48, 0.64),
}
"""By the name of the statistic, as `tests/benchmarks/fit_auto.py` prints them."""

STATISTICS = tuple(THRESHOLDS)  # in the order of the questions

MATD3_COMMON = 0.47
"""The largest `common_reward` at which `matd3` was measured and is as good as `iql`.

It scores far below the data where robots share more. As `fit_auto.py` prints it.
"""

MATD3_STEPS = 500_000
"""The fewest joint steps for `matd3`: measured on a million, it is worse on three of four minis."""

MATD3_ROBOTS = 8
"""The largest team for `matd3`, which fails with 16."""


@dataclass(frozen=True)
class EpisodeStatistics:
    """What the choice is made by; each is from 0 to 1."""

    common_reward: float  # correlation of the returns of two robots of an episode
    best_success: float  # share of its episodes that some behavior policy solves at least
    best_shift: float  # distance of the policies of the best episodes to those of all

    @classmethod
    def of(cls, dataset: Dataset) -> "EpisodeStatistics":
        """Measures a dataset, usually a train split."""
        table = dataset.episodes
        if not len(table):
            raise SpecError(f"{dataset.id} has no episodes to choose an algorithm for")
        returns = [rewards.sum(axis=0, dtype=np.float64) for (rewards,) in dataset.read("rewards")]
        n_policies = int(table.policy.max()) + 1
        counts = np.bincount(table.policy, minlength=n_policies)
        solved = np.bincount(table.policy, weights=table.success, minlength=n_policies)
        n_best = max(1, round(BEST_SHARE * len(table)))
        is_best = table.team_return >= np.sort(table.team_return)[-n_best]
        best = np.bincount(table.policy[is_best], minlength=n_policies)
        return cls(
            common_reward=_common_share(np.array(returns)),
            best_success=max(
                wilson_interval(int(k), int(n)).low
                for k, n in zip(solved, counts, strict=True)
                if n
            ),
            best_shift=_shift(best, counts),
        )


def _shift(best: Int, counts: Int) -> float:
    """Total variation between the policies of the best episodes and of all, beyond chance."""
    n, p = best.sum(), counts / counts.sum()
    # about the mean of |share - p| of n of N episodes, drawn without replacement
    chance = np.sqrt(2 / np.pi * p * (1 - p) * (1 - n / counts.sum()) / n)
    return float(max((np.abs(best / n - p) - chance).sum() / 2, 0.0))


def _common_share(returns: Double) -> float:
    """The correlation of robots' returns within episodes, [n, N]: 0 if independent, 1 if equal.

    ICC(1) of Shrout & Fleiss, "Intraclass Correlations: Uses in Assessing Rater Reliability",
    Psychological Bulletin 1979, with variances that divide by n.
    """
    n_robots = returns.shape[1]
    centered = returns - returns.mean(axis=0)  # so that different roles are no variance
    total = centered.var()
    if n_robots == 1 or total == 0:
        return 0.0
    common = (n_robots * centered.mean(axis=1).var() / total - 1) / (n_robots - 1)
    return float(max(common, 0.0))


@dataclass(frozen=True)
class AlgorithmChoice:
    """One of `CANDIDATES`, and why."""

    algorithm: str
    reasons: tuple[str, ...]
    doubts: tuple[str, ...]  # what the measured datasets do not tell apart

    @property
    def line(self) -> str:
        """The choice in one line."""
        doubts = "".join(f" Not certain: {doubt}." for doubt in self.doubts)
        return f"auto takes {self.algorithm}: {'; '.join(self.reasons)}.{doubts}"


def matd3_obstacle(n_steps: int, n_robots: int) -> str | None:
    """Why data of a size do not suit `matd3`; None if they do."""
    if n_steps < MATD3_STEPS:
        return f"matd3 needs {MATD3_STEPS:,} joint steps, got {n_steps:,}"
    if n_robots > MATD3_ROBOTS:
        return f"matd3 fails with more than {MATD3_ROBOTS} robots, got {n_robots}"
    return None


def choose_algorithm(
    found: EpisodeStatistics,
    thresholds: Mapping[str, Threshold] = THRESHOLDS,
    matd3_common: float = MATD3_COMMON,
    *,
    contact_ends: bool = False,
    obstacle: str | None = None,
) -> AlgorithmChoice:
    """Chooses by the questions of this module.

    `contact_ends`: whether one ends the episode; `obstacle`: `matd3_obstacle` of the data.
    """
    has_expert, is_shifted, is_common = (
        getattr(found, name) >= thresholds[name].middle for name in STATISTICS
    )
    clone = "filtered_bc" if is_shifted else "bc"
    if contact_ends:
        obstacle = "a contact ends the episode, where iql moves too far from the data"
    elif found.common_reward > matd3_common:
        obstacle = f"matd3 is not known to be safe above {100 * matd3_common:.0f} %"
    careful = "maddpg_bc" if contact_ends else "iql"
    learner = "matd3" if obstacle is None and is_shifted else careful
    other = "filtered_bc" if is_common else learner
    limits = {name: f"(threshold {100 * thresholds[name].middle:.0f} %)" for name in STATISTICS}
    solved = f"the best policy solves at least {100 * found.best_success:.0f} % of its episodes"
    shift = f"{100 * found.best_shift:.0f} %, beyond chance, {limits['best_shift']}"
    shifted = f"the policies of the best episodes differ from those of all by {shift}"
    share = f"robots' returns correlate by {100 * found.common_reward:.0f} %"
    asked = {"best_success": (other, clone)}
    reasons = [f"{solved} {limits['best_success']}"]
    if has_expert:
        asked["best_shift"] = "bc", "filtered_bc"
        reasons.append(shifted)
    else:
        asked["common_reward"] = learner, "filtered_bc"
        reasons.append(f"{share} {limits['common_reward']}")
        if obstacle is None:
            asked["best_shift"] = careful, "matd3"
            reasons.append(shifted)
        elif not is_common and (contact_ends or is_shifted):
            reasons.append(obstacle)
    algorithm = clone if has_expert else other
    return AlgorithmChoice(algorithm, tuple(reasons), tuple(_doubts(found, thresholds, asked)))


def _doubts(
    found: EpisodeStatistics,
    thresholds: Mapping[str, Threshold],
    asked: Mapping[str, tuple[str, str]],
) -> Iterator[str]:
    """What the measured datasets do not tell apart, of the statistics that were asked for."""
    for name, pair in asked.items():
        below, above = thresholds[name]
        if pair[0] != pair[1] and below < getattr(found, name) < above:
            yield (
                f"no measured dataset has a {name.replace('_', ' ')} between {100 * below:.0f} % "
                f"and {100 * above:.0f} %, so {' and '.join(pair)} are not told apart there"
            )
    if found.best_success == 0:
        yield "no episode is marked as solved; if success was not recorded, this is a guess"


def choose_for(data: Dataset | Mixture) -> AlgorithmChoice:
    """Chooses for the train split of a dataset, and says so in the log."""
    if isinstance(data, Mixture):
        raise SpecError(
            f"{AUTO} chooses for one dataset, got a mixture, {data.id}. Name one of "
            f"{', '.join(CANDIDATES)}."
        )
    train = data.split("train")
    world = train.spec.world
    ends = world is not None and world.on_collision == "fail"
    obstacle = matd3_obstacle(train.n_steps, train.spec.n_agents)
    found = EpisodeStatistics.of(train)
    choice = choose_algorithm(found, contact_ends=ends, obstacle=obstacle)
    if isinstance(train.spec, SideSpec):
        rule = (
            "the rule was measured without opponents, whose strength decides what a success means"
        )
        choice = replace(choice, doubts=(*choice.doubts, rule))
    if np.ptp(train.episodes.team_return) == 0:
        reason = "all episodes have the same return, so that none is better than another"
        choice = AlgorithmChoice("bc", (reason,), ())
    elif len(train.episodes) < FEWEST_EPISODES:
        few = f"{len(train.episodes)} episodes are few, the rule was measured on hundreds"
        choice = replace(choice, doubts=(*choice.doubts, few))
    _LOG.info("%s", choice.line)
    return choice
