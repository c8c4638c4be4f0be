"""Exports a result set for other tools: one row per run as CSV, and marl-eval's nested JSON.

The JSON's schema is that of marl-eval's README, "Data Structure for Raw Experiment data" (Gorsane
et al., NeurIPS 2022): environment -> task -> algorithm -> run -> steps and absolute metrics, each
metric a list over episodes. Our environment is the task, our task the dataset.
"""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts import metrics
from swarmdata.types import Double


def runs_csv(results: ResultSet) -> str:
    """Writes one row per run with the means of all metrics over its episodes.

    Time to goal counts an unsolved episode as the horizon; other undefined means are empty.
    """
    rows = []
    for case in (*results.cases, *results.baselines):
        for label, runs in case.runs.items():
            for result in runs:
                values = episode_values(case, result)
                means = {name: value.mean() for name, value in values.items()}
                rows.append(_run_fields(case, label, result) | means)
    return to_csv(rows, "")


def _run_fields(case: Case, label: str, result: Result) -> dict[str, Any]:
    provenance = result.provenance
    return {
        "label": label,
        "dataset": case.dataset,
        "task": case.spec.task,
        "index": provenance.index,
        "seed": provenance.seed,
        "algorithm": provenance.algorithm,
        "updates": provenance.updates,
        "frames": provenance.frames,
        "episodes": len(result.evaluation.seeds),
    }


def episode_values(case: Case, result: Result) -> dict[str, Double]:
    """Returns all metrics of a result by episode, [n_episodes] each, with the score if it has one.

    Time to goal counts an unsolved episode as the horizon.
    """
    values = dict(result.evaluation.metrics)
    if case.spec.world is not None:
        values["time_to_goal"] = metrics.censored_times(values["time_to_goal"], case.time_limit)
    if case.reference is not None:
        values = {"score": normalized_score(values["return"], case.reference), **values}
    return values


class MarlEval(NamedTuple):
    """The document that marl-eval reads, and the labels that it cannot represent."""

    document: dict[str, Any]
    left_out: tuple[str, ...]


def marl_eval(results: ResultSet) -> MarlEval:
    """Converts results to the schema of marl-eval; write the document with `json.dumps`.

    It requires the same algorithms, with equally many runs, on all tasks of an environment; other
    labels are left out and returned. If there are no datasets, the tasks take their place.

    A run has one logged step, with the first tenth of its episodes, and all episodes as absolute
    metrics. The return, which marl-eval may normalize by its extremes, is written for each episode
    with six digits. Other metrics are written as means, which the schema allows, to keep files of
    1000 episodes small. A metric that is undefined in some episode is left out.
    """
    cases = results.cases or results.baselines
    document: dict[str, Any] = {}
    left_out: list[str] = []
    for environment in dict.fromkeys(case.spec.task for case in cases):
        group = [case for case in cases if case.spec.task == environment]
        labels = _common(group)
        left_out += [label for case in group for label in case.runs if label not in labels]
        document[environment] = {
            _task(case, group): {
                label: {
                    f"run_{index}": run
                    for index, run in enumerate(_runs(case, label, _defined(group, labels)))
                }
                for label in labels
            }
            for case in group
        }
    return MarlEval(document, tuple(dict.fromkeys(left_out)))


def _common(group: list[Case]) -> list[str]:
    """The labels that all cases have, with the most frequent number of runs."""
    everywhere = [label for label in group[0].runs if all(label in case.runs for case in group)]
    counts = {label: {len(case.runs[label]) for case in group} for label in everywhere}
    usual = Counter(next(iter(n)) for n in counts.values() if len(n) == 1).most_common(1)
    return [label for label in everywhere if usual and counts[label] == {usual[0][0]}]


def _task(case: Case, group: list[Case]) -> str:
    """Name of a case that no other of its environment has."""
    is_unique = sum(other.name == case.name for other in group) == 1
    return case.name if is_unique else f"{case.name}-{case.spec.hash()[:8]}"


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


def _runs(case: Case, label: str, names: list[str]) -> list[dict[str, Any]]:
    found = []
    for result in case.runs[label]:
        values = episode_values(case, result)
        first = max(1, len(result.evaluation.seeds) // 10)
        step = result.provenance.updates or result.provenance.frames or 0
        found.append(
            {
                "step_1": {
                    "step_count": step,
                    **{name: _list(name, values[name][:first]) for name in names},
                },
                "absolute_metrics": {name: _list(name, values[name]) for name in names},
            }
        )
    return found


def _list(name: str, values: Double) -> list[float]:
    shown = values if name == "return" else [values.mean()]
    return [float(f"{value:.6g}") for value in shown]
