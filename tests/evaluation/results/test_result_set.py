"""Folders of results become one table, or are refused with every reason and file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import DatasetNotFoundError, ResultsError, SchemaError, UnknownNameError
from swarmdata.evaluation.results.result_files import Result, save_result
from swarmdata.evaluation.results.result_set import group_results, read_results, reference_of
from swarmdata.evaluation.runs.provenance import file_name
from swarmdata.learn.training.run_files import run_hash
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import published
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult
from tests.support.measured import COOP_NAV, EXPERT, MEDIUM, grid, result
from tests.support.tiny import TINY, make_tiny

FORMATION = preset("formation")


def test_results_are_sorted_by_dataset_label_and_seed(tmp_path: Path) -> None:
    results = grid({"bc": {EXPERT: 5.0, MEDIUM: 2.0}, "omar": {MEDIUM: 1.0, EXPERT: 1.0}})
    for each in [result("idle", None), *results[::-1]]:
        save_result(each, tmp_path / each.provenance.label)
    found = read_results([tmp_path / "bc", tmp_path / "omar", tmp_path / "idle"])
    assert found.datasets == (MEDIUM, EXPERT)  # by the mean return of their data
    assert found.labels == ("omar", "bc")  # the lowest first
    assert [case.dataset for case in found.baselines] == [None]
    assert found.scores["bc"][EXPERT].shape == (3, 20)
    case = found.case(EXPERT)
    assert [each.provenance.seed for each in case.runs["bc"]] == [0, 1, 2]
    returns = case.metric("bc", "return")
    np.testing.assert_array_equal(returns[1], results[1].evaluation.metrics["return"])
    assert len(found.results) == 13
    assert case.trained == ("omar", "bc")


def test_the_score_and_the_mean_of_the_data_stand_beside() -> None:
    found = group_results(grid({"bc": {MEDIUM: 2.0}}))
    (case,) = found.cases
    reference = reference_of(COOP_NAV)
    assert reference is not None
    assert case.reference == reference
    returns = case.metric("bc", "return")
    span = reference.expert - reference.no_skill
    expected = 100 * (returns - reference.no_skill) / span
    np.testing.assert_allclose(found.scores["bc"][MEDIUM], expected)
    assert case.data == published()[MEDIUM]
    mean = published()[MEDIUM].mean_return
    assert case.data_score == pytest.approx(100 * (mean - reference.no_skill) / span)


def test_the_data_do_not_stand_beside_results_of_another_task() -> None:
    soft = COOP_NAV.with_updates(backend="mujoco")
    for spec, has_data in ((preset("coop_nav-strict"), False), (soft, True)):
        (case,) = group_results([result(spec=spec)]).cases
        assert case.reference is not None
        assert (case.data is not None) == has_data
        assert case.recorded == COOP_NAV


def test_the_data_of_a_side_have_no_score_because_others_played_against_it() -> None:
    side = SideSpec(whole=preset("tag"), side="evader", opponents="scripted")
    (case,) = group_results([result()]).cases
    assert case.data_score is not None
    assert replace(case, spec=side, reference=reference_of(side)).data_score is None


def test_a_view_is_scored_like_its_world_and_is_a_case_of_its_own() -> None:
    lidar = with_models(COOP_NAV, "lidar")
    found = group_results([result(), result(spec=lidar, view='{"observation":"lidar"}')])
    assert len(found.cases) == 2
    assert {case.reference for case in found.cases} == {reference_of(COOP_NAV)}
    assert sum(name.startswith(f"{MEDIUM}@") for name in found.datasets) == 1


def test_who_learned_from_other_rewards_is_a_row_of_the_same_case() -> None:
    strict = '{"rewards":{"robot_collision":1.5}}'
    (case,) = group_results([result(), result("safe", view=strict)]).cases
    assert case.name == MEDIUM
    assert set(case.runs) == {"bc", "safe"}
    assert case.rewards == {"safe": {"robot_collision": 1.5}}
    with pytest.raises(ResultsError, match="2 results of bc number 0"):
        group_results([result(), result(view=strict)])


def test_reobserved_rows_share_a_case_whatever_they_learned_from() -> None:
    lidar, models = with_models(COOP_NAV, "lidar"), '"observation":"lidar"'
    rows = [
        result(spec=lidar, view=f"{{{models}}}"),
        result("safe", spec=lidar, view=f'{{{models},"rewards":{{"time":0.5}}}}'),
    ]
    (case,) = group_results(rows).cases
    assert case.name.startswith(f"{MEDIUM}@")
    assert case.view == {"observation": "lidar"}
    assert len({file_name(each.provenance, lidar.hash()) for each in rows}) == 2


def test_worlds_without_references_have_no_score() -> None:
    found = {name: reference_of(preset(name)) for name in preset_names()}
    assert found["coop_nav"] is not None
    assert found["coop_nav-wheeled"] == found["coop_nav-unicycle"]
    assert reference_of(TaskSpec(horizon=7)) is None
    (case,) = group_results([result(spec=TaskSpec(horizon=7))]).cases
    with pytest.raises(SchemaError, match="no references were measured in coop_nav"):
        case.scores("bc")
    assert case.data_score is None
    assert case.time_limit == pytest.approx(0.7)
    with pytest.raises(UnknownNameError, match="Did you mean 'return'"):
        case.metric("bc", "retrun")
    with pytest.raises(UnknownNameError, match="unknown label of coop_nav-medium-v1 'bcc'"):
        case.metric("bcc", "return")


@pytest.mark.slow
def test_the_mean_of_an_own_dataset_is_read_from_its_files(tmp_path: Path) -> None:
    from swarmdata.store import read_manifest

    folder = make_tiny(tmp_path / "tiny")
    digest = read_manifest(folder).digest
    own = result(spec=TINY.spec)
    provenance = own.provenance.model_copy(update={"dataset": "coop_nav-tiny-v0", "digest": digest})
    own = replace(own, provenance=provenance)
    assert group_results([own]).cases[0].data is None
    figures = group_results([own], data=[folder]).cases[0].data
    assert figures is not None
    assert figures.n_steps > 0
    other = replace(own, provenance=provenance.model_copy(update={"digest": "0" * 64}))
    assert group_results([other], data=[folder]).cases[0].data is None


def test_baselines_stand_beside_the_dataset_and_online_ones_are_marked() -> None:
    online = result("bc", None, frames=100, algorithm="mappo")
    found = group_results([result(), result("idle", None, mean=-12.0), online])
    (case,) = found.cases
    whole = found.with_baselines(case)
    assert list(whole.runs) == ["idle", "bc (online)", "bc"]
    assert whole.trained == ("bc",)
    (alone,) = found.baselines
    assert found.with_baselines(alone).runs == alone.runs


def test_several_tasks_may_stand_together() -> None:
    found = group_results([result("idle", None), result("idle", None, spec=FORMATION), result()])
    assert [case.spec.task for case in found.baselines] == ["coop_nav", "formation"]
    with pytest.raises(UnknownNameError, match="unknown dataset with results"):
        found.case("coop_nav-medum-v0")


def test_an_empty_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match="swarmdata evaluate"):
        read_results([tmp_path])


def with_(made: Result, **changes: Any) -> Result:
    return replace(made, provenance=made.provenance.model_copy(update=changes))


def mine(made: Result, **changes: Any) -> Result:
    return with_(made, dataset="coop_nav-mine-v0", **changes)


def shorter(made: Result) -> Result:
    old = made.evaluation
    metrics = {name: values[:5] for name, values in old.metrics.items()}
    return replace(
        made, evaluation=EvalResult(old.policy, old.task, old.spec_hash, old.seeds[:5], metrics)
    )


LIDAR = with_models(COOP_NAV, "lidar")


@pytest.mark.parametrize(
    ("results", "message"),
    [
        ([result(), with_(result(index=1), code_version="0")], "measured by version 0"),
        ([result(), shorter(result(index=1))], r"20 episodes from seed \d+ .*; 5 episodes"),
        ([result(), result(index=1, spec=LIDAR)], "on coop_nav-medium-v1: measured in coop_nav"),
        ([result(), with_(result(index=1), updates=7)], r"bc: trained for 1,000 .*; 7 updates"),
        (
            [result(), with_(result("bc", EXPERT), config={"discount": 0.9, "tau": 1})],
            r"discount 0.95, tau None \(bc-0\); discount 0.9, tau 1",
        ),
        ([result(), with_(result(index=1), algorithm="omar")], "bc: trained by bc .*; omar"),
        ([result(), result()], "2 results of bc number 0 on coop_nav-medium-v1"),
        ([result(), with_(result(), index=1)], "2 results of bc are of the training seed 0"),
        ([result(), with_(result("vdn"), digest="0" * 64)], "but the published one has"),
        (
            [mine(result()), mine(result(index=1), digest="0" * 64)],
            "on coop_nav-mine-v0: of digest",
        ),
        ([result(), result("idle", None, spec=LIDAR)], "measured under other models than"),
        ([result("random", None), result("idle", None, spec=LIDAR)], "observation lidar"),
    ],
)  # fmt: skip
def test_mixed_results_are_refused(results: list[Result], message: str) -> None:
    with pytest.raises(ResultsError, match=message):
        group_results(results)
    group_results(results, is_checked=False)


def test_every_reason_is_named_with_its_files(tmp_path: Path) -> None:
    for each in [result(), *(with_(result(index=k), updates=k, code_version="0") for k in (1, 2))]:
        save_result(each, tmp_path)
    with pytest.raises(ResultsError) as caught:
        read_results([tmp_path])
    reasons = str(caught.value).splitlines()[1:]
    assert len(reasons) == 2
    assert all(str(tmp_path) in reason for reason in reasons)


def test_results_of_a_run_that_went_on_are_stale(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "bc"
    run.mkdir(parents=True)
    (run / "config.json").write_text('{"dataset": "x"}')
    (run / "checkpoint.safetensors").write_text("1000 updates")
    made = with_(result(), run=str(run), content=run_hash(run, 0))
    folder = tmp_path / "results"
    save_result(made, folder)
    read_results([folder])
    (run / "checkpoint.safetensors").write_text("2000 updates")
    with pytest.raises(ResultsError, match=r"since they were evaluated: \.\./runs/bc"):
        read_results([folder])
    run.rename(tmp_path / "elsewhere")
    read_results([folder])  # the file is all there is
