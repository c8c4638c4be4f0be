"""A file of Python or of ONNX acts as the policy does, robot by robot, without torch."""

import ast
import json
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, PolicyFitError
from swarmdata.registry.components import make_task
from swarmdata.types import Float
from tests.learn.deployment.small_policies import (
    CASES,
    Case,
    mixed_team,
    names_of,
    trained,
    with_own_networks,
)

pytestmark = pytest.mark.slow

MOST = 2e-6
"""Largest difference of an action."""

Robot = Callable[[Float, int, Float | None], tuple[Float, Float]]
"""Rows of observations and of memories of a robot, by number, to its actions and memories."""


def export_to(path: Path) -> Callable[..., Path]:
    if path.suffix == ".py":
        from swarmdata.learn.deployment.numpy_file import export_numpy

        return export_numpy
    pytest.importorskip("onnxscript", reason="the extra 'onnx'")
    from swarmdata.learn.deployment.onnx_file import export_onnx

    return export_onnx


def exported(policy: Any, dataset: Dataset, path: Path) -> tuple[Robot, dict[str, Any]]:
    """What acts as the file says, and what the file says of it."""
    export_to(path)(policy, path, about={"label": "mine"}, **names_of(dataset))
    return of_python(path) if path.suffix == ".py" else of_onnx(path)


def of_python(path: Path) -> tuple[Robot, dict[str, Any]]:
    """The file needs NumPy alone, and can be looked at."""
    tree = ast.parse(path.read_text())
    found = {node.names[0].name for node in ast.walk(tree) if isinstance(node, ast.Import)}
    found |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert found == {"base64", "io", "json", "typing", "numpy"}
    assert max(map(len, path.read_text().splitlines())) <= 100
    policy = runpy.run_path(str(path))["Policy"]()

    def act(rows: Float, robot: int, memory: Float | None) -> tuple[Float, Float]:
        memories: Any = [None] * len(rows) if memory is None else memory
        answers = [
            policy.step(row, robot, *([] if each is None else [each]))
            for row, each in zip(rows, memories, strict=True)
        ]
        return np.stack([each[0] for each in answers]), np.stack([each[1] for each in answers])

    return act, policy.about


def of_onnx(path: Path) -> tuple[Robot, dict[str, Any]]:
    onnxruntime = pytest.importorskip("onnxruntime", reason="the group 'interop'")
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])

    def act(rows: Float, robot: int, memory: Float | None) -> tuple[Float, Float]:
        inputs = {"observation": np.ascontiguousarray(rows), "robot": np.full(len(rows), robot)}
        if memory is None:
            (actions,) = session.run(["action"], inputs)
            return actions, np.zeros((len(rows), 0), np.float32)
        actions, later = session.run(["action", "next_memory"], {**inputs, "memory": memory})
        return actions, later

    return act, json.loads(session.get_modelmeta().custom_metadata_map["swarmdata"])


@pytest.fixture(params=["policy.py", "policy.onnx"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / str(request.param)


def check(policy: Any, dataset: Dataset, path: Path) -> None:
    """Every robot's actions in an episode, together and alone, and what the file says."""
    act, about = exported(policy, dataset, path)
    observations = dataset[0].observations
    expected = policy.actions(observations)
    assert np.ptp(expected) > 0.01
    for robot in range(expected.shape[1]):
        rows = observations[:, robot]
        actions, _ = act(rows, robot, None)
        np.testing.assert_allclose(actions, expected[:, robot], rtol=0, atol=MOST)
        np.testing.assert_allclose(act(rows[:1], robot, None)[0], actions[:1], rtol=0, atol=MOST)
    assert about["label"] == "mine"
    assert about["robots"] == list(dataset.spec.agent_names)
    assert {len(names) for names in about["features"].values()} == {observations.shape[2]}


@pytest.mark.parametrize("kind", ["actor", "bins"])
def test_robots_with_networks_of_their_own(kind: str, data: Dataset, path: Path) -> None:
    check(with_own_networks(kind, data), data, path)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_robot_acts_as_in_the_team(case: Case, data: Dataset, path: Path) -> None:
    check(*case.trained(data, path.parent), path)


@pytest.mark.parametrize("n_unicycles", [2, 4])
def test_a_unicycle_acts_in_the_frame_of_its_heading(n_unicycles: int, path: Path) -> None:
    dataset = mixed_team(path.parent, n_unicycles)
    check(trained("bc", dataset, path.parent, "auto"), dataset, path)


def test_a_robot_remembers(data: Dataset, path: Path) -> None:
    from swarmdata.envs.world.task_env import TaskEnv

    policy = trained("bc", data, path.parent, "target", memory="gru", window=4)
    act, about = exported(policy, data, path)
    env = TaskEnv(make_task(data.task), 3)
    step = env.reset(np.arange(3, dtype=np.uint64))
    policy.reset(step, np.arange(3))
    memory = [np.zeros((3, about["memory"]), np.float32)] * data.spec.n_agents
    for _ in range(6):
        actions = policy.act(step)
        for robot in range(data.spec.n_agents):
            found, memory[robot] = act(step.observations[:, robot], robot, memory[robot])
            np.testing.assert_allclose(found, actions[:, robot], rtol=0, atol=1e-5)
        step = env.step(actions)
    assert all(np.abs(each).max() > 0 for each in memory)


def test_what_does_not_fit_is_refused(data: Dataset, path: Path) -> None:
    policy, export = with_own_networks("actor", data), export_to(path)
    few = {**names_of(data), "features": [["a"]] * data.spec.n_agents}
    with pytest.raises(ConversionError, match="features, got names of 1"):
        export(policy, path, about={}, **few)
    flow = trained("bc_flow", data, path.parent / "flow", "target")
    with pytest.raises(PolicyFitError, match="FlowPolicy cannot be exported"):
        export(flow, path, about={}, **names_of(data))
    path.write_text("mine")
    with pytest.raises(ConversionError, match="exists already"):
        export(policy, path, about={}, **names_of(data))
    assert path.read_text() == "mine"


def test_an_operation_that_numpy_lacks_is_named(
    data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swarmdata.learn.deployment import numpy_file

    monkeypatch.delitem(numpy_file.TRANSLATIONS, "tanh")
    with pytest.raises(PolicyFitError, match=r"aten\.tanh.*Export it as ONNX"):
        exported(with_own_networks("actor", data), data, tmp_path / "other.py")
    assert not (tmp_path / "other.py").exists()
