"""Policies that were written and read act the same."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import swarmdata
from swarmdata.behavior_policies.simple import Idle
from swarmdata.errors import CheckpointError
from swarmdata.learn.policies.policy_file import load_policy, save_policy
from swarmdata.learn.training.checkpoint import save_checkpoint
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.registry.components import make_env
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step
from tests.support.own_task import nothing_registered


@pytest.mark.parametrize("parameters", ["shared", "separate"])
@pytest.mark.parametrize("frame", ["world", "target"])
@pytest.mark.parametrize("communication", ["none", "state"])
def test_a_policy_comes_back_as_it_was(
    tmp_path: Path, parameters: str, frame: str, communication: str
) -> None:
    spec = with_models(TaskSpec(), None, communication)
    config = MAPPOConfig(n_copies=2, n_steps=4, parameters=parameters, frame=frame)  # type: ignore[arg-type]
    run = MAPPO(make_env(spec, 4), (0, 1), config)
    policy = run.policy(1)
    step = make_env(spec, 3).reset(np.arange(3, dtype=np.uint64))
    actions = policy.act(step)  # a policy that has acted remembers it, which is not written
    assert not policy.log_probs(step, actions).any()
    save_policy(tmp_path / "new" / "policy.safetensors", policy)
    read = load_policy(tmp_path / "new" / "policy.safetensors")
    assert [f.name for f in fields(read)] == [f.name for f in fields(policy)]  # type: ignore[arg-type]
    assert not read.log_probs(step, actions).any()
    assert np.isneginf(read.log_probs(step, actions * np.float32(0.5))).all()
    np.testing.assert_array_equal(read.act(step), actions)


def test_another_checkpoint_is_no_policy(tmp_path: Path) -> None:
    save_checkpoint(tmp_path / "other.safetensors", {"x": torch.zeros(1)}, {"kind": "Cat"})
    with pytest.raises(CheckpointError, match="'Cat', expected one of"):
        load_policy(tmp_path / "other.safetensors")


def test_what_no_file_can_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="class Idle cannot be written"):
        save_policy(tmp_path / "idle.safetensors", Idle(TaskSpec()))
    assert not list(tmp_path.iterdir())


def test_a_file_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "newer.safetensors"
    save_checkpoint(path, {"x": torch.zeros(1)}, {"kind": "TorchPolicy", "color": "red"})
    with pytest.raises(CheckpointError, match="TorchPolicy that this version cannot read"):
        load_policy(path)


@dataclass
class Steady:
    """A policy of a user: every robot always acts alike."""

    action: torch.Tensor  # [A]
    name: str

    def act(self, step: Step) -> Float:
        return self.action.numpy()[None, None].repeat(len(step.states), 0).repeat(4, 1)


@dataclass
class Listed:
    """Fields of a user's policy, some with names that those of this package have, too."""

    layers: Any
    n_choices: int = 3
    ranges: tuple[tuple[int, ...], ...] = ((0, 1),)
    frame: str = "world"
    slots: int = 2
    uses_state: bool = False


class Searching:
    """The part of a user's online algorithm that says what its policies are."""

    POLICIES = (Steady, Listed)


def test_a_users_online_algorithm_keeps_policies_of_its_own(tmp_path: Path) -> None:
    path, policy = tmp_path / "steady.safetensors", Steady(torch.tensor([0.5, -1.0]), "up")
    with nothing_registered():
        with pytest.raises(CheckpointError, match=r"class Steady .* among the POLICIES"):
            save_policy(path, policy)  # type: ignore[arg-type]
        swarmdata.register_algorithm("searching", Searching, online=True)
        save_policy(path, policy)  # type: ignore[arg-type]
        read = load_policy(path)
        assert isinstance(read, Steady)
        assert read.name == "up"
        assert torch.equal(read.action, policy.action)
    with pytest.raises(CheckpointError, match="'searching', which is defined by another package"):
        load_policy(path)


def test_a_users_policy_may_have_lists_of_tensors_and_any_names(tmp_path: Path) -> None:
    """They were a traceback at the first policy that was saved, or files that nobody could read."""
    path, weights = tmp_path / "listed.safetensors", [[torch.eye(2), torch.ones(2)], "tanh", None]
    with nothing_registered():
        swarmdata.register_algorithm("searching", Searching, online=True)
        save_policy(path, Listed(weights))  # type: ignore[arg-type]
        read: Any = load_policy(path)
        assert read == Listed(read.layers, ranges=[[0, 1]])  # type: ignore[arg-type]
        assert read.layers[1:] == ["tanh", None]
        assert [each.tolist() for each in read.layers[0]] == [[[1, 0], [0, 1]], [1, 1]]
        with pytest.raises(CheckpointError, match="'layers' of a policy is array"):
            save_policy(path, Listed(np.ones(2)))  # type: ignore[arg-type]
