"""Small checkpoints: the same policies of every algorithm, and nothing else."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import swarmdata
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import CheckpointError
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.compact import compact, is_same
from swarmdata.learn.training.run_files import CHECKPOINT
from swarmdata.learn.training.run_folder import COMPACT, load_run, read_run
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.runtime import own_components
from swarmdata.testing.sample_batches import sample_step
from tests.support.pairs import every


@pytest.fixture(scope="module")
def data(tiny: Path) -> Dataset:
    return Dataset.open(tiny).split("train")


@pytest.mark.parametrize("name", every(3, sorted(OFFLINE_ALGORITHMS)))
def test_policies_of_every_algorithm_survive(name: str, data: Dataset, tmp_path: Path) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name).Config
    layers = {each.name for each in fields(kind) if isinstance(each.default, tuple)}
    widths = {each: (32, 32) for each in layers if each.endswith("hidden")}
    config = kind(n_updates=2, batch_size=16, **widths)
    policies = train_seeds(name, data, tmp_path, seeds=(0, 1), config=config, progress=False)
    about = read_run(tmp_path)
    assert (about.dataset, about.digest) == (data.id, data.digest)
    assert (about.n_episodes, about.min_return) == (len(data), None) or name == "filtered_bc"
    before = (tmp_path / CHECKPOINT).stat().st_size
    compact(tmp_path)
    assert is_same(load_run(tmp_path), policies)
    assert not is_same(*policies)  # of two seeds
    tensors, metadata = load_checkpoint(tmp_path / CHECKPOINT)
    assert metadata[COMPACT]
    assert (tmp_path / CHECKPOINT).stat().st_size < before / 2
    assert not any("adam" in key or "optimizer" in key for key in tensors)
    content = (tmp_path / CHECKPOINT).read_bytes()
    compact(tmp_path)
    assert (tmp_path / CHECKPOINT).read_bytes() == content
    again = train_seeds(name, data, tmp_path, seeds=(0, 1), config=config, progress=False)
    assert is_same(again, policies)


class Growing:
    """An algorithm of one's own: Adam's moments appear with the first update."""

    LOSSES = ("loss",)

    @dataclass(frozen=True)
    class Config:
        n_updates: int = 2
        batch_size: int = 16
        discount: float = 1.0

    def __init__(self, setup: Any, config: Any) -> None:
        self.actions = torch.randn(len(setup.seeds), 2).requires_grad_()
        self.adam = torch.optim.Adam([self.actions])

    def update(self, batch: Any) -> dict[str, Any]:
        losses = (batch.actions - self.actions[:, None, None]).square().mean((1, 2, 3))
        losses.sum().backward()
        self.adam.step()
        return {"loss": losses.detach()}

    def policy(self, index: int) -> FunctionPolicy:
        action = self.actions[index].detach().numpy().copy()
        return FunctionPolicy(lambda seen: np.broadcast_to(action, (*seen.shape[:2], 2)))

    def state_dict(self) -> dict[str, Any]:
        moments = {f"adam.{k}": v.clone() for k, v in self.adam.state[self.actions].items()}
        return {"actions": self.actions.detach().clone(), **moments}

    def load_state_dict(self, state: Any) -> None:
        self.actions.data.copy_(state["actions"])
        self.adam.state[self.actions] = {k[5:]: v for k, v in state.items() if k != "actions"}


@dataclass
class Constant(FunctionPolicy):
    """One whose policies can be compared."""

    action: Any

    def __post_init__(self) -> None:
        super().__init__(lambda seen: np.broadcast_to(self.action, (*seen.shape[:2], 2)))


@pytest.mark.parametrize("is_comparable", [False, True])
def test_own_algorithms_keep_what_their_policies_need(
    is_comparable: bool, data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_components, "_here", {group: {} for group in own_components.GROUPS})
    monkeypatch.setenv(own_components.REGISTERED_VARIABLE, "{}")
    if is_comparable:
        monkeypatch.setattr(Growing, "policy", lambda self, index: Constant(
            self.actions[index].detach().clone()
        ))  # fmt: skip
    swarmdata.register_algorithm("growing", Growing)
    (policy,) = train_seeds(
        "growing", data, tmp_path, seeds=(0,), config=Growing.Config(), progress=False
    )
    compact(tmp_path)
    (loaded,) = load_run(tmp_path)
    step = sample_step()
    assert np.array_equal(loaded.act(step), policy.act(step))
    tensors, _ = load_checkpoint(tmp_path / CHECKPOINT)
    assert {"algorithm.actions", "algorithm.adam.exp_avg"} <= set(tensors)


def test_a_run_that_is_not_finished_is_refused(data: Dataset, tmp_path: Path) -> None:
    config = resolve("algorithm", OFFLINE_ALGORITHMS, "bc").Config(n_updates=40, batch_size=16)

    def stop(updates: int) -> None:
        if (tmp_path / CHECKPOINT).exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_seeds(
            "bc", data, tmp_path, config=config, schedule=Schedule(1, 10), progress=False,
            report=stop,
        )  # fmt: skip
    with pytest.raises(CheckpointError, match="is at update 10 of 40; finish it"):
        compact(tmp_path)


def test_what_is_not_the_same_is_told_apart() -> None:
    constant = Constant(torch.zeros(2))
    assert is_same([constant], (constant,))
    assert not is_same(constant, Constant(torch.ones(2)))
    assert not is_same(torch.zeros(2), torch.zeros(3))
    assert not is_same(torch.zeros(1), 0.0)
    assert not is_same([1], [1, 2])
