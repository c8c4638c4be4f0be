"""Evaluation is the same however it is run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.numerics.random import EVALUATION_BASE, evaluation_seeds
from swarmdata.registry.components import make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import check_comparable, evaluate
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult

METRICS = metrics_of("coop_nav")

SPEC = TaskSpec(horizon=30)


SEEK = FunctionPolicy(lambda observations: observations[..., 6:8])  # straight at the goal


def result(policy: str = "seek", n: int = 5, **changes: Any) -> EvalResult:
    rng = np.random.default_rng(len(policy))
    metrics = {name: rng.normal(size=n) for name in METRICS}
    metrics["time_to_goal"][::2] = np.nan
    made = EvalResult(policy, "coop_nav", "f" * 64, evaluation_seeds(n), metrics)
    return replace(made, **changes)


def test_evaluation_does_not_depend_on_the_number_of_copies() -> None:
    few, many = (
        evaluate(SEEK, SPEC, name="seek", n_episodes=9, n_copies=n, progress=False) for n in (2, 64)
    )
    assert few.policy == "seek"
    assert (few.task, few.spec_hash) == ("coop_nav", SPEC.hash())
    assert few.seeds.tolist() == [EVALUATION_BASE + k for k in range(9)]
    assert list(few.metrics) == list(METRICS)
    for name in METRICS:
        np.testing.assert_array_equal(few.metrics[name], many.metrics[name])
    assert (few.metrics["path_length"] > 0.3).all()
    assert (few.metrics["length"] == 30).any()


def test_no_episodes_are_refused() -> None:
    with pytest.raises(SchemaError, match="n_episodes is 0, expected at least 1"):
        evaluate(SEEK, SPEC, n_episodes=0)


def test_an_unknown_block_is_refused() -> None:
    block: Any = "test"
    with pytest.raises(UnknownNameError, match="unknown block of seeds 'test'"):
        evaluate(SEEK, SPEC, n_episodes=1, block=block, progress=False)


def test_only_results_of_one_spec_and_the_same_seeds_compare() -> None:
    check_comparable([result(), result("other")])
    with pytest.raises(SchemaError, match="'seek' and 'old' are of different specs"):
        check_comparable([result(), result("old", spec_hash="0" * 64)])
    with pytest.raises(SchemaError, match=r"different seeds \(5 and 4 episodes\)"):
        check_comparable([result(), result("short", n=4)])
    with pytest.raises(SchemaError, match="no results to compare"):
        check_comparable([])


def test_a_side_is_measured_against_opponents() -> None:
    spec = preset("tag").with_updates(horizon=30)
    options: dict[str, Any] = {"n_episodes": 3, "progress": False}
    whole = evaluate(make_policy("scripted", spec), spec, **options)
    named = evaluate("scripted", spec, side="evader", opponents="scripted", **options)
    assert named.task == "tag: evader against scripted"
    assert named.spec_hash != whole.spec_hash
    assert named.metrics["success"].tolist() == [1, 1, 1]
    assert whole.metrics["success"].tolist() == [0, 0, 0]
    np.testing.assert_array_equal(named.metrics["return"], whole.metrics["evader_return"])
    assert named.metrics["time_to_goal"].tolist() == pytest.approx([3.0] * 3)
    still = FunctionPolicy(lambda observations: 0.0 * observations[..., :2])
    idle = evaluate(still, spec, side="evader", opponents=still, **options)
    assert idle.metrics["path_length"].tolist() == [0, 0, 0]
    for side, opponents in (("evader", None), (None, "idle")):
        with pytest.raises(SpecError, match="expected both, or neither"):
            evaluate(still, spec, side=side, opponents=opponents, **options)
    with pytest.raises(SchemaError, match=r"of the evader returned .* are named, and not built"):
        evaluate(make_policy("idle", spec), spec, side="evader", opponents="idle", **options)
