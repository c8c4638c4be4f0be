"""Policies of every kind that can be exported, trained for a moment or not at all."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmdata.datasets.dataset import Dataset
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.specs.task_spec import TaskSpec
from tests.support.tiny import make_tiny


def trained(algorithm: str, dataset: Dataset, folder: Path, anchor: str, **settings: Any) -> Any:
    from swarmdata.learn.training.trainer import train_seeds
    from tests.learn.training.test_trainer import config_of

    (policy,) = train_seeds(
        algorithm, dataset, folder / "run", seeds=(0,),
        config=config_of(algorithm, n_updates=5, **settings),
        frame=frame_of(dataset.spec, anchor), progress=False,
    )  # fmt: skip
    return policy


@dataclass(frozen=True)
class Case:
    """What to train, and what its robots see."""

    algorithm: str
    settings: dict[str, Any] = field(default_factory=dict)
    anchor: str = "target"
    communication: str | None = None

    def __str__(self) -> str:
        return "-".join((self.algorithm, *self.settings.values(), self.anchor))

    def trained(self, data: Dataset, folder: Path) -> tuple[Any, Dataset]:
        """The policy and the dataset with what its robots heard."""
        chosen = self.communication
        dataset = data if chosen is None else data.reobserve(communication=chosen)
        return trained(self.algorithm, dataset, folder, self.anchor, **self.settings), dataset


CASES = (
    Case("bc"),
    Case("bc", {"output": "clip"}, "world"),
    Case("bc", communication="lossy-30"),
    Case("maddpg_bc", communication="state"),
    Case("iql", communication="delayed-2"),
    Case("vdn", {"regulariser": "bc"}),
    Case("qmix", {"regulariser": "cql"}),
    Case("vdn", {"regulariser": "bcq"}, "world"),
)


def mixed_team(folder: Path, n_unicycles: int) -> Dataset:
    """Of four robots, the last of them unicycles."""
    unicycle = {"name": "unicycle", "count": n_unicycles, "robot": {"dynamics": "unicycle"}}
    others = [{"count": 4 - n_unicycles}] if n_unicycles < 4 else []
    spec = TaskSpec.parse({"team": [*others, unicycle]})
    return Dataset.open(make_tiny(folder / "mixed", spec=spec))


def names_of(dataset: Dataset) -> dict[str, Any]:
    """Arguments of exports: the names of robots and of their features."""
    names = [feature.name for feature in features_of(make_task(dataset.task))]
    return {"robots": dataset.spec.agent_names, "features": [names] * dataset.spec.n_agents}


def with_own_networks(kind: str, dataset: Dataset) -> Any:
    """An actor, or a policy of bins, whose robots have networks of their own with drawn weights."""
    import torch

    from swarmdata.learn.networks.perceptrons import MLPShape
    from swarmdata.learn.networks.team_networks import Team
    from swarmdata.learn.policies.choice_policy import BinPolicy
    from swarmdata.learn.policies.torch_policy import TorchPolicy

    frame, n = frame_of(dataset.spec, "target"), dataset.spec.n_agents
    assert frame is not None
    size = dataset[0].observations.shape[2] + frame.n_added
    shape = MLPShape(size, (8,), 2 if kind == "actor" else 2 * 5)
    layers = Team(shape, n, [0], 0, parameters="separate", device="cpu").extract(0)
    mean, std = torch.zeros(size).double(), torch.ones(size).double()
    if kind == "actor":
        return TorchPolicy(layers, mean, std, True, frame, parameters="separate")
    return BinPolicy(layers, mean, std, 5, frame, parameters="separate")
