"""Distillation: what students copy, and checkpoints of before."""

import json
from pathlib import Path

import pytest
import torch

from swarmdata.errors import CheckpointError
from swarmdata.learn.flows.one_step_actor import Distillation
from swarmdata.learn.networks.network_inputs import normal_like
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.training.checkpoint import load_checkpoint, save_checkpoint
from swarmdata.learn.training.compact import is_same
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG
from swarmdata.learn.training.run_folder import load_run
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.offline_algos.bc_flow import BCFlowConfig
from swarmdata.runtime.atomic import write_file
from tests.offline_algos.toys import SIZES, random_batch, same_side, statistics

K, B = 2, 6


def made(*, debiased: bool) -> Distillation:
    config = BCFlowConfig(flow_hidden=(8,), n_flow_steps=2, debiased=debiased)
    return Distillation(Setup(SIZES, (0, 1), statistics()), config, (8,), learning_rate=1e-3)


@pytest.mark.parametrize("bias", [0.0, 5.0])
@pytest.mark.parametrize("debiased", [True, False])
def test_students_spread_as_the_flow_does_about_the_mean_of_the_data(
    bias: float, debiased: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = made(debiased=debiased)
    monkeypatch.setattr(copy.flow, "sample", lambda x, z, alive: bias + 0.1 * z)
    batch, z = random_batch(K, B), torch.randn(K, B, 2, 2)
    a = batch.actions
    setup, x = Setup(SIZES, (0, 1), statistics()), torch.zeros(K, B, SIZES.information)
    others = normal_like(setup.generators(), a)
    expected = a + 0.1 * z - 0.1 * others if debiased else bias + 0.1 * z
    torch.testing.assert_close(copy.targets(x, z, batch, setup.generators()), expected)


def test_a_run_of_before_gives_its_policies_and_does_not_go_on(tmp_path: Path) -> None:
    data = same_side(4)
    config = BCFlowConfig(n_updates=2, batch_size=4, hidden=(8,), flow_hidden=(8,), n_flow_steps=2)
    trained = train_seeds("bc_flow", data, tmp_path, seeds=(0,), config=config, progress=False)
    tensors, metadata = load_checkpoint(tmp_path / CHECKPOINT)
    older = {k: v for k, v in tensors.items() if "teacher" not in k}
    older["algorithm.flow"] = torch.zeros(1, 7)  # of another shape
    save_checkpoint(tmp_path / CHECKPOINT, older, metadata)
    described = json.loads((tmp_path / CONFIG).read_text(encoding="utf-8"))
    del described["config"]["debiased"]
    write_file(tmp_path / CONFIG, json.dumps(described).encode())
    assert is_same(load_run(tmp_path), trained)
    with pytest.raises(CheckpointError, match="debiased"):
        train_seeds("bc_flow", data, tmp_path, seeds=(0,), config=config, progress=False)


@pytest.mark.parametrize("is_older", [True, False])
def test_without_actors_a_checkpoint_is_damaged(is_older: bool) -> None:
    copy = made(debiased=True)
    state = copy.state_dict()
    lacking = {"actor", "teacher"} if is_older else {"actor"}
    state = {name: tensor for name, tensor in state.items() if name not in lacking}
    with pytest.raises(KeyError, match="actor"):
        copy.load_state_dict(state)
