"""The performance of reference policies: the table of cards and scores, and `references.json`."""

import json
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.errors import SchemaError
from swarmdata.registry.published import (
    GAP_METRICS,
    REFERENCE_OPPONENTS,
    Interval,
    TaskReferences,
    references_of,
    side_references,
)
from swarmdata.rollouts.evaluate import check_comparable
from swarmdata.rollouts.metrics import EPISODE_METRICS, SOLVED_TIME, metrics_of
from swarmdata.rollouts.score_statistics import bootstrap, mean
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import REFERENCES
from swarmdata.types import Double, EvalResult, Metric

BOOTSTRAP_SEED = 0

REFERENCES_TITLE = "\n## Reference scores\n"

REFERENCE_METRICS = ("return", "success", "clean_success", "time_to_goal", "robot_collisions",
                     "obstacle_collisions")  # fmt: skip

SCORE_FORMULA = "100 * (R - no_skill) / (expert - no_skill)"  # the score of a mean team return R

LESS_COORDINATED = {
    "scripted-alone": "each robot acts as if the others were not there",
    "scripted-naive": "each robot takes the others for parked where they are",
    "scripted-deaf": "no message arrives",
}
"""Policies of `behavior_policies.uncoordinated`, which the coordination gap compares."""


def summarize(
    results: Mapping[str, Sequence[EvalResult]],
    backend: str = "pymunk",
    naive_teams: Collection[str] = (),
) -> TaskReferences:
    """Returns the reference table of one spec.

    A reference of several checkpoints is their mean per episode. `results` are by policy, one per
    checkpoint, all on the same spec and seeds; `naive_teams` of the task have a gap too.

    Raises:
        SchemaError: no results, or results that cannot be compared.
    """
    flat = [result for group in results.values() for result in group]
    check_comparable(flat)
    empty = [name for name, group in results.items() if not group]
    if empty:
        raise SchemaError(f"reference policies {empty} have no results, expected at least one each")
    return TaskReferences(
        spec_hash=flat[0].spec_hash,
        n_episodes=len(flat[0].seeds),
        made_with=made_with(backend),
        policies={
            name: {
                metric: interval(np.stack([result.metrics[metric] for result in group]))
                for metric in group[0].metrics
            }
            for name, group in results.items()
        },
        gaps={
            name: {metric: _gap(results["scripted"], group, metric) for metric in GAP_METRICS}
            for name, group in results.items()
            if name in {*LESS_COORDINATED, *naive_teams} and "scripted" in results
        },
    )


def _gap(team: Sequence[EvalResult], less: Sequence[EvalResult], metric: str) -> Interval:
    found = interval(team[0].metrics[metric][None] - less[0].metrics[metric][None])
    assert found is not None, metric  # metrics that every episode has
    return found


def made_with(backend: str = "pymunk") -> dict[str, str]:
    """Versions that a number measured in a simulator depends on."""
    packages = ["swarmdata", "numpy", "numba", "pymunk", *["mujoco"] * (backend == "mujoco")]
    return {**{name: version(name) for name in packages}, "python": platform.python_version()}


def interval(values: Double) -> Interval | None:
    """Mean with its 95 % bootstrap interval over episodes, None if no episode defines the metric.

    Values are [checkpoints, n_episodes]; NaN is undefined.
    """
    defined = ~np.isnan(values)
    counts = defined.sum(axis=0)
    per_episode = np.where(defined, values, 0.0).sum(axis=0)[counts > 0] / counts[counts > 0]
    if not len(per_episode):
        return None
    generator = np.random.Generator(np.random.PCG64(BOOTSTRAP_SEED))
    estimate = bootstrap(mean, per_episode[:, None], generator=generator)
    return Interval(value=estimate.value, low=estimate.low, high=estimate.high)


def gap_section(known: TaskReferences, naive_teams: Collection[str]) -> str:
    """The coordination gaps of a task as Markdown; empty where they were not measured."""
    if not known.gaps:
        return ""
    columns = {"success": ("success", 100.0), "clean success": ("clean_success", 100.0)}
    if known.reference is not None:
        span = known.reference.expert - known.reference.no_skill
        columns["score"] = ("return", 100.0 / span)
    rows = [
        (name, *(_points(gaps[metric], scale) for metric, scale in columns.values()))
        for name, gaps in known.gaps.items()
    ]
    head = ("gap to", *columns)
    return f"\n{markdown.table(head, rows, is_numeric=True)}{_best_naive(known, naive_teams)}"


def _best_naive(known: TaskReferences, naive_teams: Collection[str]) -> str:
    solved = {name: known.policies[name]["success"] for name in known.gaps if name in naive_teams}
    shares = {name: each for name, each in solved.items() if each is not None}
    if not shares:
        return ""
    name, best = max(shares.items(), key=lambda item: item[1].value)
    return (
        f"\nThe best of {len(shares)} teams that do not act together is `{name}`, which solves "
        f"{_points(best, 100.0)} %.\n"
    )


def _points(found: Interval, scale: float) -> str:
    value, low, high = (scale * each for each in (found.value, found.low, found.high))
    return f"{value:.1f} [{low:.1f}, {high:.1f}]"


def reference_bytes(spec: Spec) -> bytes | None:
    """Returns the file's content: the anchors of the score, and every metric of each policy.

    In a task of several sides, those of each side by its name. None where no references were
    measured on exactly this spec.
    """
    if spec.world is None:
        return None
    names = metrics_of(spec.task)
    known = references_of(spec.hash())
    content = (
        {side: _content(each, names) for side, each in side_references(spec.world).items()}
        if known is None
        else _content(known, names)
    )
    return json.dumps(content, indent=1, allow_nan=False).encode() + b"\n" if content else None


def _content(known: TaskReferences, names: Mapping[str, Metric]) -> dict[str, Any]:
    return {
        "about": (
            f"The performance of reference policies in this task: means over {known.n_episodes} "
            "reserved evaluation episodes, policies without noise, with the low and high ends of "
            "their 95 % bootstrap intervals over episodes. null: no episode defines the metric."
        ),
        "spec_hash": known.spec_hash,
        "n_episodes": known.n_episodes,
        "made_with": known.made_with,
        "score": {
            "formula": SCORE_FORMULA,
            "R": "mean over episodes of the team return (episodes/team_return), the undiscounted "
            "sum over steps of the mean reward over agents",
            "no_skill": known.no_skill,
            "expert": known.expert,
        },
        "metrics": {
            name: {"unit": metric.unit, "better": metric.better, "meaning": metric.meaning}
            for name, metric in names.items()
        },
        "policies": asdict(known)["policies"],
    }


def references_section(
    known: TaskReferences | None,
    spec: TaskSpec,
    mean_return: float,
    *,
    has_task_rewards: bool = True,
) -> str:
    """Returns the section of a dataset, or that nothing was measured.

    A dataset whose rewards are not those of the spec has no score.
    """
    if known is None:
        return f"{REFERENCES_TITLE}\n{_of_sides(spec)}"
    score = known.score(mean_return)
    anchors = "There is no score yet, because no expert was measured.\n"
    if not has_task_rewards:
        anchors = "This dataset has no score: its rewards are not those of the task.\n"
    elif score is not None:
        anchors = f"{_scale(known)} The mean return of this dataset scores {score:.1f}.\n"
    return (
        f"{REFERENCES_TITLE}\n{_table(known)}\n"
        f"{_how(known)} {anchors}"
        f"`{REFERENCES}` beside this card has all metrics at full precision.\n"
        + gap_section(known, spec.rules.naive_teams)
    )


def _of_sides(spec: TaskSpec) -> str:
    """The references of each side, or that nothing was measured."""
    tables = [
        f"The {side}, against the {REFERENCE_OPPONENTS} others:\n\n{_table(known)}\n{_how(known)} "
        f"{_scale(known)}\n{gap_section(known, spec.rules.naive_teams)}"
        for side, known in side_references(spec).items()
    ]
    return "\n".join(tables) or "No reference policies were measured for this spec.\n"


def _table(known: TaskReferences) -> str:
    rows = [
        (policy, *(_interval(metrics.get(name)) for name in REFERENCE_METRICS))
        for policy, metrics in known.policies.items()
    ]
    labels = tuple(
        SOLVED_TIME if name == "time_to_goal" else EPISODE_METRICS[name].label
        for name in REFERENCE_METRICS
    )
    return markdown.table(("policy", *labels), rows)


def _how(known: TaskReferences) -> str:
    return (
        f"Means over {known.n_episodes:,} reserved evaluation seeds with 95 % bootstrap "
        "intervals; the policies act without noise."
    )


def _scale(known: TaskReferences) -> str:
    """The formula of the score; empty where no expert was measured."""
    if known.reference is None:
        return ""
    return (
        f"Score = 100 (R - R0) / (R1 - R0) with R0 = {known.no_skill:.3f}, the better of the "
        f"idle and the random team, and R1 = {known.expert:.3f}, the expert."
    )


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return "never"
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
