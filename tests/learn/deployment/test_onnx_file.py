"""A file of ONNX acts as the policy does, robot by robot, without torch."""

import json
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
onnxruntime = pytest.importorskip("onnxruntime", reason="the group 'interop'")
pytest.importorskip("onnxscript", reason="the extra 'onnx'")

pytestmark = pytest.mark.slow


def exported(policy: Any, dataset: Dataset, path: Path) -> Any:
    from swarmdata.learn.deployment.onnx_file import export_onnx

    export_onnx(policy, path, about={"label": "mine"}, **names_of(dataset))
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_robot_acts_as_in_the_team(case: Case, tiny: Dataset, tmp_path: Path) -> None:
    check(*case.trained(tiny, tmp_path), tmp_path / "policy.onnx")


def test_a_unicycle_acts_in_the_frame_of_its_heading(tmp_path: Path) -> None:
    dataset = unicycles(tmp_path)
    policy = trained("bc", dataset, tmp_path, "own.heading")
    check(policy, dataset, tmp_path / "policy.onnx")


def check(policy: Any, dataset: Dataset, path: Path) -> None:
    """Every robot's actions in an episode, together and alone, and what the file says."""
    session = exported(policy, dataset, path)
    observations = dataset[0].observations
    expected = policy.actions(observations)
    n = expected.shape[1]
    for robot in range(n):
        inputs = {
            "observation": np.ascontiguousarray(observations[:, robot]),
            "robot": np.full(len(observations), robot),
        }
        (actions,) = session.run(["action"], inputs)
        np.testing.assert_allclose(actions, expected[:, robot], atol=2e-6)
        alone = {name: values[:1] for name, values in inputs.items()}
        np.testing.assert_allclose(session.run(["action"], alone)[0], actions[:1], atol=2e-6)
    known = json.loads(session.get_modelmeta().custom_metadata_map["swarmdata"])
    assert known["label"] == "mine"
    assert known["robots"] == list(dataset.spec.agent_names)
    assert {len(names) for names in known["features"].values()} == {observations.shape[2]}


@pytest.mark.parametrize("kind", ["actor", "bins"])
def test_robots_with_networks_of_their_own(kind: str, tiny: Dataset, tmp_path: Path) -> None:
    check(with_own_networks(kind, tiny), tiny, tmp_path / "policy.onnx")


def test_a_robot_remembers(tiny: Dataset, tmp_path: Path) -> None:
    from swarmdata.envs.world.task_env import TaskEnv

    policy = trained("bc", tiny, tmp_path, "target", memory="gru", window=4)
    session = exported(policy, tiny, tmp_path / "policy.onnx")
    env = TaskEnv(make_task(tiny.task), 3)
    step = env.reset(np.arange(3, dtype=np.uint64))
    policy.reset(step, np.arange(3))
    size = json.loads(session.get_modelmeta().custom_metadata_map["swarmdata"])["memory"]
    n = len(tiny.spec.agent_names)
    memory = {robot: np.zeros((3, size), np.float32) for robot in range(n)}
    for _ in range(6):
        actions = policy.act(step)
        for robot in range(n):
            inputs = {
                "observation": np.ascontiguousarray(step.observations[:, robot]),
                "robot": np.full(3, robot),
                "memory": memory[robot],
            }
            action, memory[robot] = session.run(["action", "next_memory"], inputs)
            np.testing.assert_allclose(action, actions[:, robot], atol=1e-5)
        step = env.step(actions)


def test_what_does_not_fit_is_refused(tiny: Dataset, tmp_path: Path) -> None:
    from swarmdata.learn.deployment.onnx_file import export_onnx

    policy = trained("bc", tiny, tmp_path, "target")
    named = names_of(tiny)
    few = {**named, "features": [["a"]] * tiny.spec.n_agents}
    with pytest.raises(ConversionError, match="features, got names of 1"):
        export_onnx(policy, tmp_path / "x.onnx", about={}, **few)
    flow = trained("bc_flow", tiny, tmp_path / "flow", "target")
    with pytest.raises(PolicyFitError, match="FlowPolicy cannot be exported"):
        export_onnx(flow, tmp_path / "x.onnx", about={}, **named)
    (tmp_path / "x.onnx").write_text("mine")
    with pytest.raises(ConversionError, match="exists already"):
        export_onnx(policy, tmp_path / "x.onnx", about={}, **named)
    assert (tmp_path / "x.onnx").read_text() == "mine"
