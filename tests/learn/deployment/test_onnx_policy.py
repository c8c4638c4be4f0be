"""Files of ONNX act as teams, whoever made them; what does not fit is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import CheckpointError, SpecError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy

onnx = pytest.importorskip("onnx", reason="the extra 'onnx'")
pytest.importorskip("onnxruntime", reason="the extra 'onnx'")

from swarmdata.learn.deployment.onnx_policy import OnnxPolicy  # noqa: E402

SPEC = TaskSpec(horizon=12)


def write(
    file: Path, *, memory: int = 0, n_features: int | None = None, scale: float = 1.0, seed: int = 0
) -> Path:
    """A linear network, with the running sum of its actions as memory if there is one."""
    n, o = SPEC.action_size, n_features or SPEC.observation_size
    weights = scale * np.random.default_rng(seed).normal(0, 0.1, (o, n)).astype(np.float32)
    make, kind = onnx.helper.make_tensor_value_info, onnx.TensorProto.FLOAT
    nodes = [onnx.helper.make_node("MatMul", ["observation", "w"], ["raw"])]
    inputs, outputs = [make("observation", kind, ["b", o])], [make("action", kind, ["b", n])]
    if memory:
        nodes.append(onnx.helper.make_node("Add", ["raw", "memory"], ["next_memory"]))
        nodes.append(onnx.helper.make_node("Tanh", ["next_memory"], ["action"]))
        inputs.append(make("memory", kind, ["b", memory]))
        outputs.append(make("next_memory", kind, ["b", memory]))
    else:
        nodes.append(onnx.helper.make_node("Tanh", ["raw"], ["action"]))
    constant = onnx.numpy_helper.from_array(weights, "w")
    graph = onnx.helper.make_graph(nodes, "policy", inputs, outputs, [constant])
    opset = [onnx.helper.make_opsetid("", 17)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=9), file)
    return file


@pytest.mark.parametrize("memory", [0, 2])
def test_it_keeps_the_contract(memory: int, tmp_path: Path) -> None:
    file = write(tmp_path / "p.onnx", memory=memory)
    check_policy(OnnxPolicy(file, SPEC), SPEC, make_env)


def test_the_command_line_finds_it(tmp_path: Path) -> None:
    target = find_target(str(write(tmp_path / "mine.onnx")))
    assert target.label == "mine"
    assert isinstance(target.policies[0], OnnxPolicy)
    with pytest.raises(SpecError, match=r"there is no folder at .*, expected that of a training"):
        find_target(str(tmp_path / "other.onnx"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"n_features": 3}, "has the inputs"), ({"scale": np.nan}, "expected finite numbers")],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=words):
        check_policy(OnnxPolicy(write(tmp_path / "p.onnx", **changes), SPEC), SPEC, make_env)


def test_what_is_no_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.onnx").write_bytes(b"no network")
    with pytest.raises(CheckpointError, match="is no network of ONNX"):
        OnnxPolicy(tmp_path / "p.onnx", SPEC)
