"""Exports a result set for other tools: one row per run as CSV, and marl-eval's nested JSON."""

from collections import Counter
from typing import Any

import numpy as np

from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, ResultSet, unique_names
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts import metrics
from swarmdata.types import Double


def runs_csv(results: ResultSet) -> str:
    """Writes one row per run with the means of all metrics over its episodes.

    Time to goal counts an unsolved episode as the horizon; other undefined means are empty.
    """
    fields = ("index", "seed", "algorithm", "updates", "frames")
    rows = [
        {
            "label": label,
            "dataset": case.dataset,
            "task": case.spec.task,
            **{name: getattr(result.provenance, name) for name in fields},
            "episodes": len(result.evaluation.seeds),
            **{name: values.mean() for name, values in episode_values(case, result).items()},
        }
        for case in (*results.cases, *results.baselines)
        for label, runs in case.runs.items()
        for result in runs
    ]
    return to_csv(rows, "")


def episode_values(case: Case, result: Result) -> dict[str, Double]:
    """Returns all metrics of a result by episode, [n_episodes] each, with the score if it has one.

    Time to goal counts an unsolved episode as the horizon.
    """
    values = dict(result.evaluation.metrics)
    if case.world is not None:
        values["time_to_goal"] = metrics.censored_times(values["time_to_goal"], case.time_limit)
    if case.reference is not None:
        values = {"score": normalized_score(values["return"], case.reference), **values}
    return values


def marl_eval(results: ResultSet) -> tuple[dict[str, Any], list[str]]:
    """Converts results to the schema of marl-eval; returns it with the labels that it cannot hold.

    The schema is that of its README, "Data Structure for Raw Experiment data" (Gorsane et al.,
    NeurIPS 2022): environment -> task -> algorithm -> run -> steps and absolute metrics, each
    metric a list over episodes. Our environment is the task, our task the dataset; if there are no
    datasets, the task again. All tasks of an environment need the same algorithms, with equally
    many runs; other labels are left out.

    A run has one logged step, with the first tenth of its episodes, and all episodes as absolute
    metrics. The return, which marl-eval may normalize by its extremes, is written for each episode
    with six digits, other metrics as means, to keep files of 1000 episodes small. A metric that is
    undefined in some episode is left out.
    """
    cases = results.cases or results.baselines
    document: dict[str, Any] = {}
    left_out: dict[str, None] = {}
    for environment in dict.fromkeys(case.spec.task for case in cases):
        group = [case for case in cases if case.spec.task == environment]
        labels = _common(group)
        left_out |= {label: None for case in group for label in case.runs if label not in labels}
        defined = _defined(group, labels)
        document[environment] = {
            name: {label: _runs(case, label, defined) for label in labels}
            for name, case in zip(unique_names(group), group, strict=True)
        }
    return document, list(left_out)


def _common(group: list[Case]) -> list[str]:
    """The labels that all cases have, with the most frequent number of runs."""
    everywhere = [label for label in group[0].runs if all(label in case.runs for case in group)]
    counts = {label: {len(case.runs[label]) for case in group} for label in everywhere}
    usual = Counter(next(iter(n)) for n in counts.values() if len(n) == 1).most_common(1)
    return [label for label in everywhere if usual and counts[label] == {usual[0][0]}]


def _defined(group: list[Case], labels: list[str]) -> list[str]:
    """The metrics that are defined in all episodes of all runs."""
    runs = [
        episode_values(case, result)
        for case in group
        for label in labels
        for result in case.runs[label]
    ]
    return [
        name
        for name in (runs[0] if runs else ())
        if all(name in run and np.isfinite(run[name]).all() for run in runs)
    ]


def _runs(case: Case, label: str, names: list[str]) -> dict[str, Any]:
    found = {}
    for index, result in enumerate(case.runs[label]):
        values, provenance = episode_values(case, result), result.provenance
        first = max(1, len(result.evaluation.seeds) // 10)
        count = {"step_count": provenance.updates or provenance.frames or 0}
        found[f"run_{index}"] = {
            "step_1": count | {name: _list(name, values[name][:first]) for name in names},
            "absolute_metrics": {name: _list(name, values[name]) for name in names},
        }
    return found


def _list(name: str, values: Double) -> list[float]:
    shown = values if name == "return" else [values.mean()]
    return [float(f"{value:.6g}") for value in shown]
