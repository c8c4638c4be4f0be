"""A file of ONNX acts as the policy does, robot by robot, without torch."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, PolicyFitError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.rollouts.task_frame import frame_of
from swarmdata.specs.task_spec import TaskSpec
from tests.support.tiny import make_tiny

torch = pytest.importorskip("torch", reason="algorithms need torch")
onnxruntime = pytest.importorskip("onnxruntime", reason="the group 'interop'")
pytest.importorskip("onnxscript", reason="the extra 'onnx'")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset.open(make_tiny(tmp_path_factory.mktemp("tiny") / "tiny"))


def trained(algorithm: str, dataset: Dataset, folder: Path, anchor: str, **settings: Any) -> Any:
    from swarmdata.learn.training.trainer import train_seeds
    from tests.learn.training.test_trainer import config_of

    (policy,) = train_seeds(
        algorithm, dataset, folder / "run", seeds=(0,),
        config=config_of(algorithm, n_updates=5, **settings),
        frame=frame_of(dataset.spec, anchor), progress=False,
    )  # fmt: skip
    return policy


def exported(policy: Any, dataset: Dataset, path: Path) -> Any:
    from swarmdata.learn.deployment.onnx_file import export_onnx

    names = [feature.name for feature in features_of(make_task(dataset.task))]
    export_onnx(
        policy, path, robots=dataset.spec.agent_names, features=names, about={"label": "mine"}
    )
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


@pytest.mark.parametrize(
    ("algorithm", "settings", "anchor", "communication"),
    [
        ("bc", {}, "target", None),
        ("bc", {"output": "clip"}, "world", None),
        ("bc", {}, "target", "lossy-30"),
        ("maddpg_bc", {}, "target", "state"),
        ("iql", {}, "target", "delayed-2"),
        ("vdn", {"regulariser": "bc"}, "target", None),
        ("qmix", {"regulariser": "cql"}, "target", None),
        ("vdn", {"regulariser": "bcq"}, "world", None),
    ],
)
def test_a_robot_acts_as_in_the_team(
    algorithm: str,
    settings: dict[str, Any],
    anchor: str,
    communication: str | None,
    tiny: Dataset,
    tmp_path: Path,
) -> None:
    dataset = tiny if communication is None else tiny.reobserve(communication=communication)
    policy = trained(algorithm, dataset, tmp_path, anchor, **settings)
    check(policy, dataset, tmp_path / "policy.onnx")


def test_a_unicycle_acts_in_the_frame_of_its_heading(tmp_path: Path) -> None:
    spec = TaskSpec.parse({"team": [{"count": 4, "robot": {"dynamics": "unicycle"}}]})
    dataset = Dataset.open(make_tiny(tmp_path / "unicycles", spec=spec))
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
    assert len(known["features"]) == observations.shape[2]


@pytest.mark.parametrize("kind", ["actor", "bins"])
def test_robots_with_networks_of_their_own(kind: str, tiny: Dataset, tmp_path: Path) -> None:
    from swarmdata.learn.networks.perceptrons import Layer
    from swarmdata.learn.policies.choice_policy import BinPolicy
    from swarmdata.learn.policies.torch_policy import TorchPolicy

    generator = torch.Generator().manual_seed(0)
    frame, n = frame_of(tiny.spec, "target"), len(tiny.spec.agent_names)
    assert frame is not None
    size = tiny[0].observations.shape[2] + frame.n_added
    outputs = 2 if kind == "actor" else 2 * 5

    def drawn(*shape: int) -> Any:
        return torch.randn(shape, generator=generator, dtype=torch.float64) / shape[-2] ** 0.5

    layers = [
        Layer(drawn(n, size, 8), drawn(n, 1, 8)),
        Layer(drawn(n, 8, outputs), drawn(n, 1, outputs)),
    ]
    mean, std = torch.zeros(size).double(), torch.ones(size).double()
    if kind == "actor":
        policy: Any = TorchPolicy(layers, mean, std, True, frame, parameters="separate")
    else:
        policy = BinPolicy(layers, mean, std, 5, frame, parameters="separate")
    check(policy, tiny, tmp_path / "policy.onnx")


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
    robots = tiny.spec.agent_names
    with pytest.raises(ConversionError, match="features, got names of 1"):
        export_onnx(policy, tmp_path / "x.onnx", robots=robots, features=["a"], about={})
    flow = trained("bc_flow", tiny, tmp_path / "flow", "target")
    with pytest.raises(PolicyFitError, match="FlowPolicy cannot be exported"):
        export_onnx(flow, tmp_path / "x.onnx", robots=robots, features=[], about={})
    names = [feature.name for feature in features_of(make_task(tiny.task))]
    (tmp_path / "x.onnx").write_text("mine")
    with pytest.raises(ConversionError, match="exists already"):
        export_onnx(policy, tmp_path / "x.onnx", robots=robots, features=names, about={})
    assert (tmp_path / "x.onnx").read_text() == "mine"
