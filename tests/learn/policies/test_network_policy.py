"""Behavior policies from any policy's file keep the contract of policies."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.behavior_policies.checkpoint_files import digest_of
from swarmdata.errors import CheckpointError, SpecError
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.learn.policies.network_policy import NetworkPolicy
from swarmdata.learn.policies.policy_file import load_policy, save_policy
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import OFFLINE_ALGORITHMS, make_env, make_task, resolve
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy
from tests.offline_algos.toys import statistics

SPEC = TaskSpec(horizon=20)


def saved(path: Path, name: str, **settings: object) -> str:
    """Writes an untrained policy; returns the SHA-256 of the file."""
    size = len(features_of(make_task(SPEC)))
    n_states = make_env(SPEC, 1).reset(np.zeros(1, np.uint64)).states.shape[1]
    sizes = Sizes(n_agents=SPEC.n_agents, observation=size, action=2, state=n_states)
    moments = replace(
        statistics(),
        observation_mean=np.zeros(size), observation_std=np.ones(size),
        state_mean=np.zeros(n_states), state_std=np.ones(n_states),
    )  # fmt: skip
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    small: dict[str, object] = {"width": 8} if name == "oryx" else {"hidden": (16,)}
    config = kind.Config(**small, **settings)
    policy = kind(Setup(sizes, (3,), moments, n_episodes=4), config).policy(0)
    save_policy(path, policy)
    return digest_of(path)


GRU = {"memory": "gru", "memory_size": 8}
FLOW = {"flow_hidden": (16,)}


@pytest.mark.parametrize(
    ("name", "settings", "noise"),
    [
        ("bc", GRU, 0.0),
        ("vdn", {"regulariser": "bc", **GRU}, 0.2),
        ("bc_flow", FLOW, 0.0),
        ("bc_flow", {"noise": "own", "redraw": "episode", **FLOW}, 0.2),
        pytest.param("bc_flow", {**FLOW, **GRU}, 0.0, marks=pytest.mark.slow),
        ("bc_latent", {}, 0.0),
        pytest.param("oryx", {}, 0.2, marks=pytest.mark.slow),
    ],
)
def test_policies_of_any_kind_keep_the_contract(
    tmp_path: Path, name: str, settings: dict[str, object], noise: float
) -> None:
    path = tmp_path / "policy.safetensors"
    sha256 = saved(path, name, **settings)
    policy = NetworkPolicy(SPEC, checkpoint=path, sha256=sha256, noise=noise)
    check_policy(policy, SPEC, make_env, n_episodes=3, n_steps=6)


@pytest.mark.parametrize("name", ["bc", "vdn", "bc_flow", "bc_latent", "oryx"])
def test_a_notebook_shows_settings_of_a_policy_and_no_weights(tmp_path: Path, name: str) -> None:
    saved(tmp_path / "policy.safetensors", name)
    shown = repr(load_policy(tmp_path / "policy.safetensors"))
    assert "observation_mean=(53,)" in shown
    assert len(shown) < 300


def test_actions_are_those_of_the_file_on_the_grid(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    policy = NetworkPolicy(SPEC, checkpoint=path, sha256=saved(path, "bc"))
    step = make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))
    policy.reset(step, np.arange(5))
    actions = policy.act(step)
    np.testing.assert_allclose(actions, load_policy(path).act(step), rtol=0.0, atol=2.0**-13)
    np.testing.assert_array_equal(actions * 2.0**12, np.rint(actions * 2.0**12))


def test_another_file_and_wrong_noise_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    sha256 = saved(path, "bc")
    with pytest.raises(SpecError, match="action noise is -1"):
        NetworkPolicy(SPEC, checkpoint=path, sha256=sha256, noise=-1.0)
    with pytest.raises(CheckpointError, match="expected 0000"):
        NetworkPolicy(SPEC, checkpoint=path, sha256="0" * 64)
