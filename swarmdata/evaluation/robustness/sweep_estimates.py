"""One point of a sweep as numbers with intervals, and what changed there since training."""

from collections.abc import Sequence

import numpy as np

from swarmdata.evaluation.results.aggregates import mean_over_runs
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, reference_of
from swarmdata.evaluation.results.result_tables import case_table
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.task_spec import TaskSpec


def estimates_of(
    runs: Sequence[Result], before: Sequence[Result], spec: TaskSpec, trained: TaskSpec
) -> tuple[tuple[Column, ...], tuple[Estimate, ...]]:
    """Returns the columns of `tables.case_table`, and what changed since training.

    Args:
        runs: one result per policy of a team at the point.
        before: of the same policies as they were trained.
        spec: of the point.
        trained: the spec that they were trained on, whose references make the score: a point with
            other sensors on the robots is in no world that has references of its own.
    """
    scale = reference_of(trained)
    label = runs[0].provenance.label
    table = case_table(Case(None, spec, scale, None, {label: tuple(runs)}))
    key = "return" if scale is None else "score"
    column = Column(f"{key}_change", f"change of {key}", "", 1 if scale else 2)
    estimates = (*table.rows[0].estimates, change_of(runs, before, scale))
    return (*table.columns, column), estimates


def change_of(
    runs: Sequence[Result], before: Sequence[Result], scale: Reference | None
) -> Estimate:
    """The difference of scores, or of returns without a scale, with its 95 % interval.

    Seed by seed and episode by episode: what differs between training seeds, or between episodes,
    is not in it, so that the interval is narrower than those of the two scores.

    Args:
        runs: one result per policy.
        before: of the same policies on the same evaluation seeds.
        scale: of the score.
    """
    sides = (
        np.stack([each.evaluation.metrics["return"] for each in side]) for side in (runs, before)
    )
    after, then = (side if scale is None else normalized_score(side, scale) for side in sides)
    return mean_over_runs(after - then)  # [runs, episodes]
