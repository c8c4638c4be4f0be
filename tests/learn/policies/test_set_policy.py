"""Policies over sets: trained with 4 robots, written, read, and run with 16."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.policies.policy_file import load_policy, save_policy
from swarmdata.learn.policies.torch_policy import SetPolicy
from swarmdata.learn.training.run_folder import load_run
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.specs.model_choice import with_models
from tests.learn.training.test_trainer import config_of


@pytest.fixture(scope="module")
def runs(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a perceptron and of networks over sets, of a clone and of an actor-critic."""
    folder = tmp_path_factory.mktemp("sets")
    data = load(tiny)
    for algorithm, network in (("bc", "mlp"), ("bc", "deep_sets"), ("maddpg_bc", "deep_sets")):
        train_seeds(
            algorithm, data, folder / f"{algorithm}-{network}", seeds=(0, 1),
            config=config_of(algorithm, n_updates=3, policy_network=network),
            frame=frame_of(data.spec), progress=False,
        )  # fmt: skip
    return folder


def policies(folder: Path) -> Iterator[SetPolicy]:
    for policy in load_run(folder):
        assert isinstance(policy, SetPolicy)
        yield policy


@pytest.mark.parametrize("name", ["bc-deep_sets", "maddpg_bc-deep_sets"])
def test_a_policy_comes_back_as_it_was_and_acts_in_other_teams(
    runs: Path, tmp_path: Path, name: str
) -> None:
    spec = with_models(preset("coop_nav-n16"), "state-7", None)
    features = features_of(make_task(spec))
    step = make_env(spec, 2).reset(np.arange(2, dtype=np.uint64))
    for policy in policies(runs / name):
        save_policy(tmp_path / "policy.safetensors", policy)
        read = load_policy(tmp_path / "policy.safetensors")
        assert isinstance(read, SetPolicy)
        actions = policy.fitted(features, spec.robots).act(step)
        assert actions.shape == (2, 16, 2)
        assert actions.dtype == np.float32
        np.testing.assert_array_equal(read.fitted(features, spec.robots).act(step), actions)
        with pytest.raises(SchemaError, match="features of any number of robots"):
            policy.act(step)


def test_robots_in_another_order_act_alike(runs: Path) -> None:
    spec = preset("coop_nav-n8")
    step = make_env(spec, 3).reset(np.arange(3, dtype=np.uint64))
    order = np.random.default_rng(0).permutation(8)
    for policy in policies(runs / "bc-deep_sets"):
        fitted = policy.fitted(features_of(make_task(spec)), spec.robots)
        actions = fitted.actions(step.observations)
        turned = fitted.actions(step.observations[:, order])
        np.testing.assert_allclose(turned, actions[:, order], atol=1e-6)


@pytest.mark.slow
def test_runs_are_evaluated_in_worlds_that_fit(runs: Path) -> None:
    target = find_target(str(runs / "bc-deep_sets"), "coop_nav-n8", "state-5")
    assert (target.spec.n_agents, target.spec.observation.n_neighbors) == (8, 5)  # type: ignore[union-attr]
    (first, _) = evaluate_target(target, 1, progress=False)
    assert first.evaluation.spec_hash == target.spec.hash()
    for name, task, complaint in (
        ("bc-mlp", "coop_nav-n8", "trained with 4 robots and cannot act with 8"),
        ("bc-deep_sets", "formation", "none are missing here, and reference.offset_x"),
        ("bc-deep_sets", "coop_nav-unicycle", "cannot drive robots that are unicycle"),
        ("bc-mlp", "coop_nav-acceleration", "holonomic with acceleration commands"),
    ):
        with pytest.raises(SchemaError, match=complaint):
            find_target(str(runs / name), task)
    assert find_target(str(runs / "bc-mlp"), "coop_nav-easy").spec == preset("coop_nav-easy")


def test_networks_over_sets_do_not_remember(tiny: Path, tmp_path: Path) -> None:
    data = load(tiny)
    config = config_of("bc", n_updates=1, batch_size=40, policy_network="deep_sets", memory="gru")
    with pytest.raises(SchemaError, match="only mlp has a memory"):
        train_seeds("bc", data, tmp_path, seeds=(0,), config=config, progress=False)
