"""One point of a sweep as numbers with intervals, and what changed there since training."""

from collections.abc import Sequence

import numpy as np

from swarmdata.metrics import Estimate, Reference, bootstrap, iqm, mean, normalized_score
from swarmdata.report import Column
from swarmdata.result_files import Result
from swarmdata.results import Case, reference_of
from swarmdata.spec import TaskSpec
from swarmdata.tables import case_table
from swarmdata.types import EvalResult


def estimates_of(
    runs: Sequence[Result], before: Sequence[Result], spec: TaskSpec, trained: TaskSpec
) -> tuple[tuple[Column, ...], tuple[Estimate, ...]]:
    """Returns the columns of `tables.case_table`, and what changed since training.

    Args:
        runs: one result per policy of a team at the point.
        before: of the same policies as they were trained.
        spec: of the point.
        trained: the spec that they were trained on, whose references make the score.
    """
    scale = reference_of(trained)
    label = runs[0].provenance.label
    table = case_table(Case(None, spec, scale, None, {label: tuple(runs)}))
    key = "return" if scale is None else "score"
    column = Column(f"{key}_change", f"change of {key}", "", 1 if scale else 2)
    now, then = ([each.evaluation for each in side] for side in (runs, before))
    estimates = (*table.rows[0].estimates, change_of(now, then, scale))
    return (*table.columns, column), estimates


def change_of(
    runs: Sequence[EvalResult], before: Sequence[EvalResult], scale: Reference | None
) -> Estimate:
    """The difference of scores, or of returns without a scale, with its 95 % interval.

    Seed by seed and episode by episode: what differs between training seeds, or between episodes,
    is not in it, so that the interval is narrower than those of the two scores.

    Args:
        runs: one result per policy.
        before: of the same policies on the same evaluation seeds.
        scale: of the score.
    """
    returns = [np.stack([each.metrics["return"] for each in side]) for side in (runs, before)]
    if scale is not None:
        returns = [normalized_score(side, scale) for side in returns]
    gaps = returns[0] - returns[1]  # [runs, episodes]
    generator = np.random.default_rng(0)
    if len(gaps) > 1:
        return bootstrap(iqm, gaps.mean(axis=1)[:, None], generator=generator)
    return bootstrap(mean, gaps.T, generator=generator)
