"""The mean of a metric over seeds and episodes, or a difference of means, with its interval."""

from collections.abc import Sequence

import numpy as np

from swarmdata.errors import SchemaError, UnknownNameError, check_type
from swarmdata.numerics.event_costs import COSTS
from swarmdata.rollouts.evaluate import check_comparable
from swarmdata.rollouts.score_intervals import (
    count_interval,
    difference_interval,
    mean_interval,
    rare_rate_interval,
    rate_difference_interval,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double, EvalResult

Results = EvalResult | Sequence[EvalResult]
"""Of one policy, or of one for each training seed."""


def estimate(results: Results, metric: str = "return", *, minus: Results | None = None) -> Estimate:
    """Estimates the mean of a metric with its 95 % interval, as tables of `evaluate` do.

        >>> iql = [swarmdata.evaluate(f, "coop_nav") for f in policies]
        >>> swarmdata.estimate(iql, "success")
        >>> swarmdata.estimate(iql, "success", minus=swarmdata.evaluate("scripted", "coop_nav"))

    The interval is for new training seeds and new episodes of the same distribution; of one result,
    for this policy on new episodes (`score_intervals.combination_interval`). Shares near 0 and 1
    have at least Wilson's, differences of shares that do not vary Newcombe's, and counts without
    events Garwood's.

    Args:
        results: of one policy, or of one for each training seed; on the same episodes.
        metric: a name in `EvalResult.metrics`.
        minus: those of another policy or algorithm on the same episodes, to estimate the
            difference, paired by episode.

    Returns:
        `value`, and the ends `low` and `high` of its interval, in the unit of the metric.

    Raises:
        SchemaError: results are of different tasks or episodes, or the metric is undefined in some
            episode, such as the time to goal of one that failed.
        UnknownNameError: no such metric.
    """
    own = _table(results, metric)
    if minus is not None:
        check_comparable([*_listed(results), *_listed(minus)])
        other = _table(minus, metric)
        are_rates = _is_rate(metric, own) and _is_rate(metric, other)
        return (rate_difference_interval if are_rates else difference_interval)(own, other)
    if _is_rate(metric, own):
        return rare_rate_interval(own)
    return count_interval(own) if metric in COSTS else mean_interval(own)


def _is_rate(metric: str, values: Double) -> bool:
    """Whether a metric is a success; an own task may call a share in an episode so, too."""
    return metric.endswith("success") and bool(np.isin(values, (0, 1)).all())


def _listed(results: Results) -> list[EvalResult]:
    found = [results] if isinstance(results, EvalResult) else list(results)
    for each in found:
        check_type("a result", each, EvalResult, "what swarmdata.evaluate returns")
    return found


def _table(results: Results, metric: str) -> Double:
    """The values of a metric, [K, E]."""
    found = _listed(results)
    check_comparable(found)
    for each in found:
        if metric not in each.metrics:
            raise UnknownNameError("metric", metric, each.metrics)
    values = np.stack([each.metrics[metric] for each in found])
    if undefined := int(np.isnan(values).sum()):
        raise SchemaError(
            f"{metric} is undefined in {undefined} of {values.size} episodes, expected a value in "
            "each: means of the others would compare different episodes"
        )
    return values
