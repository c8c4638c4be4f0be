"""RecurrentFlowPolicy acts as it was trained, forgets at a reset, and comes back from its file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from swarmdata.datasets.dataset import Dataset  # noqa: E402
from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.hub.catalog.catalog import load  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.learn.policies.policy_file import load_policy, save_policy  # noqa: E402
from swarmdata.learn.policies.recurrent_flow_policy import RecurrentFlowPolicy  # noqa: E402
from swarmdata.learn.training.dataset_statistics import Statistics  # noqa: E402
from swarmdata.learn.training.framed_dataset import framed  # noqa: E402
from swarmdata.learn.training.setup import Setup  # noqa: E402
from swarmdata.offline_algos.mac_flow import MACFlow, MACFlowConfig  # noqa: E402
from swarmdata.perception.frames import Frame, find_frame  # noqa: E402
from swarmdata.perception.observer import features_of  # noqa: E402
from swarmdata.registry.components import make_env, make_task  # noqa: E402
from swarmdata.testing.policy_contract import check_policy  # noqa: E402
from swarmdata.types import Float, Step  # noqa: E402
from tests.support.tiny import make_tiny  # noqa: E402

SETTINGS: dict[str, Any] = {
    "memory": "gru", "memory_size": 6, "burn_in": 2, "window": 4, "actor_hidden": (8,),
    "critic_hidden": (8,), "flow_hidden": (8,), "n_flow_steps": 2, "n_updates": 6,
}  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return load(make_tiny(tmp_path_factory.mktemp("flow") / "coop_nav-tiny-v0"))


@pytest.fixture(scope="module")
def frame(data: Dataset) -> Frame:
    found = find_frame(features_of(make_task(data.task)), "target")
    assert found is not None
    return found


def trained(data: Dataset, frame: Frame | None = None, **changes: Any) -> MACFlow:
    """After all updates of both stages, on windows."""
    seen, config = framed(data, frame), MACFlowConfig(**{**SETTINGS, **changes})
    sampler = seen.sampler(4, horizon=config.window, burn_in=config.burn_in, seed=0)
    first = sampler.gather(sampler.draw()[None]).to_torch()
    n_agents, n_features = first.observations.shape[-2:]
    n_actions, n_states = first.actions.shape[-1], first.states.shape[-1]
    sizes = Sizes(n_agents, n_features, n_actions, n_states, frame=frame)
    algorithm = MACFlow(Setup(sizes, [0], Statistics.measure(seen, config.discount)), config)
    for _ in range(config.n_updates):
        algorithm.update(sampler.gather(sampler.draw()[None]).to_torch())
    return algorithm


def steps_of(observations: Float, like: Step) -> list[Step]:
    """The steps of an episode that shows one copy these observations, [T, N, O]."""
    one = Step._make(field[:1] for field in like)
    return [
        one._replace(observations=row[None].copy(), times=np.full(1, time))
        for time, row in enumerate(observations)
    ]


@pytest.mark.parametrize("in_frame", [False, True])
@pytest.mark.parametrize("settings", [{}, {"noise": "own", "redraw": "episode"}])
def test_acting_step_by_step_is_the_window_from_the_start(
    data: Dataset, frame: Frame, in_frame: bool, settings: dict[str, Any]
) -> None:
    used = frame if in_frame else None
    algorithm, observations = trained(data, used, **settings), np.array(data[0].observations)
    sampler = framed(data, used).sampler(1, horizon=SETTINGS["window"], burn_in=8, seed=0)
    batch = sampler.gather(np.array([[8]])).to_torch()  # steps 0 to 11, of which 8 to 11 count
    policy = algorithm.policy(0)
    assert isinstance(policy, RecurrentFlowPolicy)
    steps = steps_of(observations[:12], make_env(data.task, 1).reset(np.zeros(1, "u8")))
    for _ in range(2):  # a reset makes every episode the first
        policy.reset(steps[0], np.arange(1))
        actions = np.concatenate([policy.act(step) for step in steps])[8:]
    noise = np.concatenate([policy.draw(step) for step in steps])[8:]
    assert (noise[0] == noise[1]).all() == ("redraw" in settings)
    actor = algorithm.copy.actor
    expected = actor(actor.see(batch).features, torch.from_numpy(noise[None]).float())
    wanted = expected[0].detach().numpy()
    if used is not None:
        wanted = used.to_world(observations[8:12], wanted).astype(np.float32)
        wanted /= np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(actions, wanted, atol=1e-5)


def test_it_keeps_the_contract_of_policies(data: Dataset, frame: Frame) -> None:
    check_policy(trained(data, frame).policy(0), data.task, make_env, n_episodes=4, n_steps=6)


def test_it_remembers_until_it_is_reset(data: Dataset) -> None:
    policy = trained(data, redraw="episode").policy(0)  # noise alone does not change actions
    step = make_env(data.task, 3).reset(np.arange(3, dtype=np.uint64))
    with pytest.raises(SchemaError, match="Call reset"):
        policy.act(step)
    policy.reset(step, np.arange(3))
    first, second = policy.act(step), policy.act(step)
    assert (first != second).any((1, 2)).all()
    policy.reset(step, np.array([1]))
    third = policy.act(step)
    np.testing.assert_array_equal(third[1], first[1])
    assert (third[[0, 2]] != first[[0, 2]]).any((1, 2)).all()


def test_log_probs_are_of_the_last_step_only(data: Dataset) -> None:
    policy = trained(data).policy(0)
    step = make_env(data.task, 2).reset(np.arange(2, dtype=np.uint64))
    policy.reset(step, np.arange(2))
    actions = policy.act(step)
    assert not policy.log_probs(step, actions).any()
    assert np.isneginf(policy.log_probs(step, actions * np.float32(0.5))).all()
    with pytest.raises(SchemaError, match="policy with memory cannot act on a step twice"):
        policy.log_probs(step._replace(times=step.times), actions)


def test_noise_is_scaled(data: Dataset) -> None:
    policy = trained(data).policy(0)
    assert isinstance(policy, RecurrentFlowPolicy)
    step = make_env(data.task, 2).reset(np.arange(2, dtype=np.uint64))
    quiet = replace(policy, noise_scale=0.25)
    np.testing.assert_array_equal(quiet.draw(step), 0.25 * policy.draw(step))


def test_it_comes_back_from_its_file_without_what_it_remembers(
    data: Dataset, frame: Frame, tmp_path: Path
) -> None:
    policy = trained(data, frame, noise_scale=0.5).policy(0)
    step = make_env(data.task, 2).reset(np.arange(2, dtype=np.uint64))
    policy.reset(step, np.arange(2))
    first = policy.act(step)
    save_policy(tmp_path / "policy.safetensors", policy)
    read = load_policy(tmp_path / "policy.safetensors")
    assert isinstance(read, RecurrentFlowPolicy)
    read.reset(step, np.arange(2))
    np.testing.assert_array_equal(read.act(step), first)
    np.testing.assert_array_equal(read.act(step), policy.act(step))
