"""A file of Python acts as the policy does, robot by robot, with NumPy alone."""

import ast
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, PolicyFitError
from swarmdata.registry.components import make_task
from tests.learn.deployment.small_policies import (
    CASES,
    Case,
    names_of,
    trained,
    unicycles,
    with_own_networks,
)

torch = pytest.importorskip("torch", reason="algorithms need torch")

MOST = 1e-6
"""Largest difference of an action."""


def exported(policy: Any, dataset: Dataset, path: Path) -> Any:
    from swarmdata.learn.deployment.numpy_file import export_numpy

    export_numpy(policy, path, about={"label": "mine"}, **names_of(dataset))
    return runpy.run_path(str(path))["Policy"]()


def check(policy: Any, dataset: Dataset, path: Path) -> None:
    """Every robot's actions in an episode, what the file says, and that it needs NumPy alone."""
    robot_policy = exported(policy, dataset, path)
    tree = ast.parse(path.read_text())
    found = {node.names[0].name for node in ast.walk(tree) if isinstance(node, ast.Import)}
    found |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert found == {"base64", "io", "json", "typing", "numpy"}
    assert max(map(len, path.read_text().splitlines())) <= 100
    observations = dataset[0].observations
    expected = policy.actions(observations)
    assert np.ptp(expected) > 0.01
    for robot in range(expected.shape[1]):
        actions = [robot_policy.step(row, robot)[0] for row in observations[:, robot]]
        np.testing.assert_allclose(actions, expected[:, robot], rtol=0, atol=MOST)
    assert robot_policy.about["label"] == "mine"
    assert robot_policy.about["robots"] == list(dataset.spec.agent_names)
    names = robot_policy.about["features"].values()
    assert {len(each) for each in names} == {observations.shape[2]}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["actor", "bins"])
def test_robots_with_networks_of_their_own(kind: str, tiny: Dataset, tmp_path: Path) -> None:
    check(with_own_networks(kind, tiny), tiny, tmp_path / "policy.py")


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_robot_acts_as_in_the_team(case: Case, tiny: Dataset, tmp_path: Path) -> None:
    check(*case.trained(tiny, tmp_path), tmp_path / "policy.py")


@pytest.mark.slow
def test_a_unicycle_acts_in_the_frame_of_its_heading(tmp_path: Path) -> None:
    dataset = unicycles(tmp_path)
    check(trained("bc", dataset, tmp_path, "own.heading"), dataset, tmp_path / "policy.py")


@pytest.mark.slow
def test_a_robot_remembers(tiny: Dataset, tmp_path: Path) -> None:
    from swarmdata.envs.world.task_env import TaskEnv

    policy = trained("bc", tiny, tmp_path, "target", memory="gru", window=4)
    robot_policy = exported(policy, tiny, tmp_path / "policy.py")
    env = TaskEnv(make_task(tiny.task), 1)
    step = env.reset(np.arange(1, dtype=np.uint64))
    policy.reset(step, np.arange(1))
    memory = [np.zeros(robot_policy.about["memory"], np.float32)] * tiny.spec.n_agents
    for _ in range(6):
        actions = policy.act(step)
        for robot, row in enumerate(step.observations[0]):
            action, memory[robot] = robot_policy.step(row, robot, memory[robot])
            np.testing.assert_allclose(action, actions[0, robot], rtol=0, atol=MOST)
        step = env.step(actions)
    assert all(np.abs(each).max() > 0 for each in memory)


@pytest.mark.slow
def test_what_does_not_fit_is_refused(
    tiny: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swarmdata.learn.deployment import numpy_file

    policy, path = with_own_networks("actor", tiny), tmp_path / "policy.py"
    few = {**names_of(tiny), "features": [["a"]] * tiny.spec.n_agents}
    with pytest.raises(ConversionError, match="features, got names of 1"):
        numpy_file.export_numpy(policy, path, about={}, **few)
    path.write_text("mine")
    with pytest.raises(ConversionError, match="exists already"):
        exported(policy, tiny, path)
    assert path.read_text() == "mine"
    monkeypatch.delitem(numpy_file.TRANSLATIONS, "tanh")
    with pytest.raises(PolicyFitError, match=r"aten\.tanh.*Export it as ONNX"):
        exported(policy, tiny, tmp_path / "other.py")
    assert not (tmp_path / "other.py").exists()
