"""The estimates at a point of a sweep, and the change compared with training."""

from collections.abc import Sequence

import numpy as np

from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, reference_of
from swarmdata.evaluation.results.result_tables import case_table
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.task_spec import TaskSpec


def estimates_of(
    runs: Sequence[Result], before: Sequence[Result], spec: TaskSpec, trained: TaskSpec
) -> tuple[tuple[Column, ...], tuple[Estimate, ...]]:
    """Returns the columns of `result_tables.case_table`, and the change compared with training.

    Args:
        runs: one result per policy of a team at the point.
        before: results of the same policies with everything as in training.
        spec: of the point.
        trained: spec of the training, whose references scale the score: a world with other sensors
            on the robots has no references.
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
    """Returns the difference of scores, or of returns without a scale, with its 95 % interval.

    Differences are paired by training seed and episode. Variation between seeds and episodes
    cancels, so the interval is narrower than those of the two scores.

    Args:
        runs: one result per policy.
        before: results of the same policies on the same evaluation seeds.
        scale: of the score.
    """
    sides = (
        np.stack([each.evaluation.metrics["return"] for each in side]) for side in (runs, before)
    )
    after, then = (side if scale is None else normalized_score(side, scale) for side in sides)
    return mean_interval(after - then)  # [runs, episodes]
