"""Which reference policies a task has."""

import importlib
from pathlib import Path

import pytest

import swarmdata
from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.target_evaluation import (
    evaluate_target,
    measure_references,
    reference_teams,
)
from swarmdata.registry.presets import preset
from swarmdata.runtime import own_components
from swarmdata.runtime.own_components import GROUPS, REGISTERED_VARIABLE

SHARED = {"idle", "random", "straight", "scripted", "scripted-alone", "scripted-naive"}
NAIVE = {"pursuit-greedy", "pursuit-lead-1", "pursuit-lead-3", "pursuit-lead-mixed"}


@pytest.mark.parametrize(
    ("task", "more"),
    [("coop_nav", set()), ("search", {"scripted-deaf"}), ("pursuit", NAIVE)],
)
def test_a_task_has_the_teams_of_its_rules(task: str, more: set[str]) -> None:
    assert set(reference_teams("own.yaml", preset(task))) == SHARED | more


def test_a_task_is_measured_with_the_teams_that_it_has(tmp_path: Path) -> None:
    file = tmp_path / "task.yaml"
    file.write_text(preset("coop_nav").with_updates(horizon=5).to_yaml())
    found = measure_references(str(file), 2, progress=False)
    assert set(found.policies) == SHARED
    assert set(found.gaps) == {"scripted-alone", "scripted-naive"}


def test_results_of_a_policy_or_task_whose_code_changed_are_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_components, "_here", {group: {} for group in GROUPS})
    monkeypatch.setenv(REGISTERED_VARIABLE, "{}")
    monkeypatch.syspath_prepend(tmp_path)
    policy, task = tmp_path / "own_idle.py", tmp_path / "own_task.py"
    policy.write_text("from swarmdata.behavior_policies.simple import Idle\n")
    task.write_text(
        "from typing import Literal\n"
        "from swarmdata.envs.coop_nav.coop_nav import CoopNav\n"
        "from swarmdata.envs.coop_nav.navigation_rules import NavigationRules\n"
        "class Rules(NavigationRules):\n    task: Literal['own_nav'] = 'own_nav'\n"
        "class OwnNav(CoopNav):\n    Rules = Rules\n"
    )
    swarmdata.register_policy("own_idle", "own_idle:Idle")
    swarmdata.register_task("own_nav", "own_task:OwnNav")
    spec = tmp_path / "spec.yaml"
    spec.write_text("rules: {task: own_nav}\nhorizon: 3\n")

    def is_kept() -> bool:
        target = find_target("own_idle", str(spec))
        (result,) = evaluate_target(target, 1, tmp_path / "out", progress=False)
        return result.path is not None

    assert [is_kept(), is_kept()] == [False, True]
    for file in (policy, task):
        file.write_text(f"{file.read_text()}# changed\n")
        assert [is_kept(), is_kept()] == [False, True]


def test_files_of_one_name_do_not_replace_each_others_results(tmp_path: Path) -> None:
    """A file that was written again does: it is what is measured now."""
    pytest.importorskip("onnxruntime", reason="the extra 'onnx'")
    write = importlib.import_module("tests.learn.deployment.test_onnx_policy").write
    task = tmp_path / "task.yaml"
    task.write_text(preset("coop_nav").with_updates(horizon=3).to_yaml())
    files = [tmp_path / name / "team.onnx" for name in ("one", "other")]

    def measure(file: Path, seed: int) -> bool:
        target = find_target(str(write(file, seed=seed)), str(task))
        (result,) = evaluate_target(target, 1, tmp_path / "out", progress=False)
        return result.path is not None

    for file in files:
        file.parent.mkdir()
    assert [measure(files[0], seed) for seed in (0, 0, 1, 1)] == [False, True, False, True]
    with pytest.raises(ResultsError, match=r"of the run \.\./one/team\.onnx, not of \.\./other/"):
        measure(files[1], 1)
