"""Reference tables and the shipped JSON files."""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from swarmdata.cards.references import gap_section, interval, reference_bytes, summarize
from swarmdata.errors import SchemaError
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.presets import preset_names
from swarmdata.registry.published import TaskReferences, references, references_of
from swarmdata.registry.recipes import FAMILY_SPECS
from swarmdata.registry.tiers import FAMILIES
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import DiscreteSpace
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult
from tests.support.measured import reference_specs

METRICS = metrics_of("coop_nav")

NOT_MEASURED = {"pursuit-easy", "pursuit-hard", "pursuit-n6"}
"""Presets without references, as their pages say."""


def make_result(policy: str, value: float, n_episodes: int = 50) -> EvalResult:
    spread = np.linspace(-1.0, 1.0, n_episodes)
    metrics = dict.fromkeys(METRICS, value + spread)
    metrics["time_to_goal"] = np.full(n_episodes, np.nan)
    seeds = evaluation_seeds(n_episodes)
    return EvalResult(policy, "coop_nav", "a" * 64, seeds, metrics)


def test_checkpoints_are_averaged_per_episode_and_undefined_values_left_out() -> None:
    values = np.array([[1.0, np.nan, 5.0], [3.0, np.nan, np.nan]])
    result = interval(values)

    assert result is not None
    assert result.value == pytest.approx((2.0 + 5.0) / 2)
    assert interval(np.full((2, 3), np.nan)) is None


def test_summary_anchors_the_score_if_it_has_all_references() -> None:
    table = summarize(
        {
            "idle": [make_result("idle", -4.0)],
            "random": [make_result("random", -12.0)],
            "expert": [make_result("expert", 5.0), make_result("expert", 7.0)],
        }
    )

    assert table.no_skill == pytest.approx(-4.0)
    assert table.expert == pytest.approx(6.0)
    assert table.score(1.0) == pytest.approx(50.0)
    assert table.policies["idle"]["time_to_goal"] is None
    assert TaskReferences.parse(asdict(table)) == table
    only_idle = summarize({"idle": [make_result("idle", -4.0)]})
    assert only_idle.no_skill is None
    assert only_idle.score(0.0) is None


def test_the_gap_of_a_task_names_its_best_naive_team() -> None:
    naive = {"bold": "drives straight", "sly": "aims ahead"}
    values = {"scripted": 0.9, "scripted-alone": 0.8, "bold": 0.1, "sly": 0.3, "idle": -4.0}
    results = {name: [make_result(name, value)] for name, value in values.items()}
    table = summarize(results, naive_teams=naive)

    assert set(table.gaps) == {"scripted-alone", *naive}
    page = gap_section(table, naive)
    assert "The best of 2 teams that do not act together is `sly`, which solves 30.0 [" in page
    assert "| gap to | success | clean success |\n" in page, "no score without an expert"
    assert "| bold | 80.0" in page
    assert "solves" not in gap_section(summarize(results), {})


def test_summary_refuses_other_seeds_and_nothing() -> None:
    with pytest.raises(SchemaError, match="different seeds"):
        summarize({"a": [make_result("a", 0.0)], "b": [make_result("b", 0.0, n_episodes=40)]})
    with pytest.raises(SchemaError, match="'b'"):
        summarize({"a": [make_result("a", 0.0)], "b": []})


def test_shipped_references_are_of_the_shipped_specs() -> None:
    wanted = {name: spec for each in preset_names() for name, spec in reference_specs(each).items()}
    assert set(wanted) - set(references()) == NOT_MEASURED
    assert set(references()) <= set(wanted)
    for name, table in references().items():
        assert table.spec_hash == wanted[name].hash()
        assert references_of(table.spec_hash) == table
        assert table.n_episodes == (200 if name == "pursuit-sight" else 1000)
        assert set(table.policies) >= {"idle", "random", "straight", "scripted"}
    assert references_of("0" * 64) is None


@pytest.mark.parametrize("family", FAMILIES)
def test_an_outsider_computes_the_score(family: str) -> None:
    """Row 46: the references were in three decimals of Markdown only."""
    content = reference_bytes(FAMILY_SPECS[family])
    assert content is not None
    whole, names = json.loads(content), reference_specs(family)
    parts = [whole] if len(names) == 1 else list(whole.values())
    for found, name in zip(parts, names, strict=True):
        check_file(found, references()[name], FAMILY_SPECS[family].task)


def check_file(found: dict[str, Any], known: TaskReferences, task: str) -> None:
    score = found["score"]
    if known.expert is None:  # nobody has trained one yet, so the task has no score
        assert score["expert"] is None
    else:
        names = {"R": -1.25, "no_skill": score["no_skill"], "expert": score["expert"]}
        assert eval(score["formula"], {"__builtins__": {}}, names) == known.score(-1.25)
        assert np.isfinite(score["expert"])
    returns = {name: policy["return"]["value"] for name, policy in found["policies"].items()}
    assert returns == {name: known.mean_return(name) for name in known.policies}
    assert score["no_skill"] == max(returns["idle"], returns["random"])
    assert set(found["metrics"]) == set(metrics_of(task))
    assert all(set(policy) == set(found["metrics"]) for policy in found["policies"].values())
    assert found["n_episodes"] == 1000


def test_what_was_not_measured_has_no_file() -> None:
    assert reference_bytes(TaskSpec(horizon=41)) is None
    agent = RecordedAgent(name="a", observation=DiscreteSpace(n=2), action=DiscreteSpace(n=2))
    spec = RecordedSpec(task="x", agents=(agent,), state_size=0, state_from="environment")
    assert reference_bytes(spec) is None
