"""Which teams the return prefers, beside success and clean success, into docs/measurements.md.

    python -m tests.benchmarks.bench_rewards [--episodes N] [--tasks NAME ...]

Six teams play the same episodes of each family of datasets. A tier is the mean of its shipped
checkpoints, without noise. Where the return prefers one team and clean success the other, the
difference in return is split into terms, and break-even factors say which weights of contacts or
of proximity would make the returns equal.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from swarmdata.cards.references import interval
from swarmdata.interfaces import Policy, Task, VecEnv
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.components import make_env, reward_terms
from swarmdata.registry.recipes import FAMILIES, FAMILY_SPECS
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.types import Double, Episode
from tests.benchmarks.measuring import table, write_section
from tests.benchmarks.teams import members

TEAMS = ("idle", "random", "straight", "scripted", "medium", "expert")
RANKED = ("return", "success", "clean_success")
METRICS = (*RANKED, "time_to_goal", "robot_collisions", "obstacle_collisions")
PARTS = ("own", "success_reward", "contacts", "proximity")
"""Parts of the return: the task's own terms (time and progress above all), success, the four
contact terms, and proximity."""

PART_OF = {
    "success": "success_reward",
    "robot_contact": "contacts",
    "obstacle_contact": "contacts",
    "robot_collision": "contacts",
    "obstacle_collision": "contacts",
    "proximity": "proximity",
}
"""The part that a term belongs to; the task's own are absent."""

FIRST_SEED = EVALUATION_BASE + (1 << 34)
"""Of the episodes here: no dataset, training, selection of checkpoints or reference uses them."""

N_EPISODES, N_COPIES = 400, 64

Outcome = Mapping[str, Double]
"""Metrics and parts of the return of a team, by name, [n_episodes]."""


class Contradiction(NamedTuple):
    """Two teams that return and clean success rank differently; differences are cleaner - other."""

    cleaner: str
    other: str
    clean_success: float
    returns: float
    parts: tuple[float, ...]  # of `returns`, in the order of `PARTS`

    @property
    def without_speed(self) -> float:
        """Difference in return without the task's own terms."""
        return self.returns - self.parts[PARTS.index("own")]

    def break_even(self, part: str) -> float | None:
        """Factor of the weights of a part with which the returns are equal, None if none is."""
        saved = self.parts[PARTS.index(part)]
        factor = 1.0 - self.returns / saved if saved else -1.0
        return factor if factor >= 0 else None


def return_parts(episode: Episode, task: Task) -> dict[str, float]:
    """The parts of an episode's return."""
    if episode.reward_terms is None:
        raise ValueError(f"episodes of {task.spec.task!r} have no reward terms, expected them")
    values = episode.reward_terms.mean(axis=1, dtype=np.float64).sum(axis=0)  # [R]
    parts = dict.fromkeys(PARTS, 0.0)
    for term, value in zip(reward_terms(task), values.tolist(), strict=True):
        parts[PART_OF.get(term.name, "own")] += term.signed_weight * value
    return parts


def play(env: VecEnv, policy: Policy, n_episodes: int) -> Outcome:
    """The outcome of one policy."""
    seeds = FIRST_SEED + np.arange(n_episodes, dtype=np.uint64)
    rows = []
    for episode in rollout(env, policy, seeds):
        measured = episode_metrics(episode, env.task)
        metrics = {name: measured[name] for name in METRICS}
        rows.append(metrics | return_parts(episode, env.task))
    return {name: np.array([row[name] for row in rows]) for name in (*METRICS, *PARTS)}


def outcome(env: VecEnv, policies: Sequence[Policy], n_episodes: int) -> Outcome:
    """The mean outcome of policies in each episode; times are the mean over those that solved."""
    played = [play(env, policy, n_episodes) for policy in policies]
    stacked = {name: np.stack([each[name] for each in played]) for name in (*METRICS, *PARTS)}
    times = stacked.pop("time_to_goal")
    n_solved = (~np.isnan(times)).sum(axis=0)
    with np.errstate(invalid="ignore"):
        mean_times = np.nansum(times, axis=0) / n_solved
    means = {name: values.mean(axis=0) for name, values in stacked.items()}
    return means | {"time_to_goal": mean_times}


def contradictions(outcomes: Mapping[str, Outcome]) -> Iterator[Contradiction]:
    """Pairs of teams whose differences in return and in clean success have opposite signs.

    Only differences count whose 95 % interval over the paired episodes excludes 0.
    """
    for pair in combinations(outcomes, 2):
        clean, value = (difference(outcomes, *pair, name) for name in ("clean_success", "return"))
        if clean * value >= 0:
            continue
        cleaner, other = pair if clean > 0 else pair[::-1]
        ours, theirs = outcomes[cleaner], outcomes[other]
        parts = tuple(float((ours[part] - theirs[part]).mean()) for part in PARTS)
        yield Contradiction(cleaner, other, abs(clean), -abs(value), parts)


def difference(outcomes: Mapping[str, Outcome], a: str, b: str, name: str) -> float:
    """Mean paired difference a - b, 0 if its 95 % interval contains 0."""
    found = interval((outcomes[a][name] - outcomes[b][name])[None])
    return 0.0 if found is None or found.low <= 0 <= found.high else found.value


def rank(outcomes: Mapping[str, Outcome], team: str, name: str) -> int:
    """The team's place by the mean of a metric, 1 for the best; equal means share a place."""
    own = outcomes[team][name].mean()
    return 1 + sum(bool(each[name].mean() > own) for each in outcomes.values())


def team_row(outcomes: Mapping[str, Outcome], team: str) -> tuple[str, ...]:
    """A row of the table of a task."""
    means = {name: float(values.mean()) for name, values in outcomes[team].items()}
    times = outcomes[team]["time_to_goal"]
    solved = times[~np.isnan(times)]
    return (
        team,
        f"{means['return']:.2f}",
        f"{100 * means['success']:.1f}",
        f"{100 * means['clean_success']:.1f}",
        " / ".join(str(rank(outcomes, team, name)) for name in RANKED),
        f"{solved.mean():.1f}" if len(solved) else "—",
        f"{means['robot_collisions']:.2f}",
        f"{means['obstacle_collisions']:.2f}",
        *(f"{means[part]:.2f}" for part in PARTS),
    )


def pair_row(pair: Contradiction) -> tuple[str, ...]:
    """A row of the table of contradictions."""
    factors = (pair.break_even(part) for part in ("contacts", "proximity"))
    return (
        pair.cleaner, pair.other, f"{100 * pair.clean_success:.1f}", f"{pair.returns:.2f}",
        *(f"{part:.2f}" for part in pair.parts), f"{pair.without_speed:.2f}",
        *("none" if factor is None else f"{factor:.2f}" for factor in factors),
    )  # fmt: skip


PART_HEADS = ("own terms", "success reward", "contacts", "proximity")
TEAM_HEAD = (
    "team", "return", "success, %", "clean, %", "ranks by return / success / clean",
    "time when solved, s", "robot collisions", "obstacle collisions", *PART_HEADS,
)  # fmt: skip
PAIR_HEAD = (
    "cleaner team", "other team", "clean, %", "return", *PART_HEADS, "return without own terms",
    "break-even factor of contacts", "of proximity",
)  # fmt: skip


def family_text(family: str, n_episodes: int) -> str:
    """Plays all teams of a family; the tables of it."""
    spec = FAMILY_SPECS[family]
    env, outcomes = make_env(spec, min(N_COPIES, n_episodes)), {}
    for team in TEAMS:
        if policies := members(team, family, spec):
            outcomes[team] = outcome(env, policies, n_episodes)
            print(f"  {family} {team}", flush=True)
    text = f"### {family}\n\n{table(TEAM_HEAD, [team_row(outcomes, team) for team in outcomes])}\n"
    found = [pair_row(pair) for pair in contradictions(outcomes)]
    text += table(PAIR_HEAD, found) if found else "Return and clean success agree on every pair.\n"
    print(text, flush=True)
    return text


INTRO = """Means over {n} episodes, the same for all teams. A tier is the mean of its shipped
checkpoints without noise. Time when solved is the mean over solved episodes. The last columns are
the parts of the return: the task's own terms, of which time and progress are the largest, the
reward for success, the four contact terms and proximity.

Below are all pairs of teams of which one has the higher return and the other the higher clean
success, both by more than the 95 % interval of the paired difference. Each number is the cleaner
team's minus the other's. Own terms are what speed and progress explain. The break-even factors are
those by which the four contact weights, or the weight of proximity, would have to be multiplied for
equal returns.
"""


def main() -> None:
    """Measures the families named on the command line, all by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--episodes", type=int, default=N_EPISODES, help="of each policy")
    parser.add_argument("--tasks", nargs="+", choices=FAMILIES, default=FAMILIES)
    options = parser.parse_args()
    texts = [family_text(family, options.episodes) for family in options.tasks]
    write_section("What rewards prefer", "\n".join([INTRO.format(n=options.episodes), *texts]))


if __name__ == "__main__":
    main()
