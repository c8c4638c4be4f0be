"""Data in a frame: batches are turned and nothing else, and policies act in the world again."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Policy
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.policies.choice_policy import ChoicePolicy
from swarmdata.learn.policies.drawn_policy import FlowPolicy, LatentPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.run_folder import load_run, read_run
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.learn.training.training_data import framed
from swarmdata.perception.frames import Frame
from swarmdata.types import Float
from tests.learn.training.test_trainer import config_of
from tests.offline_algos.toys import step_of
from tests.support.memory_dataset import MemoryDataset


def test_a_loop_of_ones_own_gets_the_batches_that_algorithms_learn_from(
    data: Dataset, frame: Frame
) -> None:
    """`batch.in_frame(dataset.frame)` is public; without a frame a batch stays as recorded."""
    ours = framed(data.split("train"), frame).sampler(16, seed=3)
    theirs = data.split("train").sampler(16, seed=3)
    for _ in range(2):
        expected, recorded = ours.gather(ours.draw()), next(theirs)
        got = recorded.in_frame(data.frame)
        for field in dataclasses.fields(expected):
            assert np.array_equal(getattr(got, field.name), getattr(expected, field.name))
    assert not np.array_equal(got.actions, recorded.actions)
    assert recorded.in_frame(None) is recorded
    assert data.reobserve(observation="lidar").frame is None


def test_batches_are_those_of_the_data_turned(data: Dataset, frame: Frame) -> None:
    plain, turned = (each.sampler(32, seed=3) for each in (data, framed(data, frame)))
    index = plain.draw()
    np.testing.assert_array_equal(turned.draw(), index)
    world, seen = plain.gather(index), turned.gather(index)
    np.testing.assert_array_equal(seen.observations, frame.inputs(world.observations))
    np.testing.assert_array_equal(seen.next_observations, frame.inputs(world.next_observations))
    for name in ("rewards", "states", "next_states", "terminations", "truncations", "mask"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(world, name))
    for now, then in (("observations", "actions"), ("next_observations", "next_actions")):
        recorded, back = (
            getattr(world, then),
            frame.to_world(getattr(world, now), getattr(seen, then)),
        )
        norm = np.maximum(np.linalg.norm(recorded, axis=-1, keepdims=True), 1)
        np.testing.assert_allclose(back, recorded / norm, atol=1e-6)


@pytest.mark.parametrize("name", ["observations", "actions", "next_actions", "rewards"])
def test_a_field_alone_is_turned_as_with_all_others(data: Dataset, frame: Frame, name: str) -> None:
    """Though actions are turned by what the robots observe."""
    sampler, index = framed(data, frame).sampler(16, seed=3), np.arange(16)
    some = sampler.gather(index, {name})
    np.testing.assert_array_equal(getattr(some, name), getattr(sampler.gather(index), name))
    assert some.states is None


def test_windows_are_turned_step_by_step(data: Dataset, frame: Frame) -> None:
    sampler = framed(data, frame).sampler(16, horizon=5, burn_in=3, seed=3)
    plain = data.sampler(16, horizon=5, burn_in=3, seed=3)
    index = np.arange(16)
    seen, world = sampler.gather(index), plain.gather(index)
    mask = world.mask
    assert not mask.all()
    np.testing.assert_array_equal(seen.mask, mask)
    inputs = frame.inputs(world.observations[mask])
    np.testing.assert_array_equal(seen.observations[mask], inputs)
    back = frame.to_world(world.observations[mask], seen.actions[mask])
    norm = np.maximum(np.linalg.norm(world.actions[mask], axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(back, world.actions[mask] / norm, atol=1e-6)


def test_observations_are_normalized_as_they_are_seen(data: Dataset, frame: Frame) -> None:
    whole = framed(data, frame)
    measured = Statistics.measure(whole, 0.9)
    every = frame.inputs(np.concatenate([episode.observations[:-1] for episode in data]))
    spread = every.std((0, 1))
    near = 0.05 * spread + 1e-3  # they are measured on a sample
    assert (np.abs(measured.observation_mean - every.mean((0, 1))) < near).all()
    assert (np.abs(measured.observation_std - spread) < near).all()
    world = Statistics.measure(data, 0.9)
    assert (measured.return_std, measured.max_return) == (world.return_std, world.max_return)


def test_statistics_are_those_of_the_same_episodes_in_memory(data: Dataset) -> None:
    train = data.split("train")
    stored = Statistics.measure(train, 0.9)
    memory = Statistics.measure(MemoryDataset(list(train)), 0.9)
    np.testing.assert_allclose(stored.state_mean, memory.state_mean)
    np.testing.assert_allclose(stored.state_std, memory.state_std)
    np.testing.assert_allclose(stored.observation_std, memory.observation_std, rtol=1e-5)
    assert stored.max_return == memory.max_return


def acted(policy: Policy, observations: Float) -> Float:
    return policy.act(step_of(len(observations))._replace(observations=observations))


@pytest.mark.parametrize("algorithm", ["bc", "vdn", "bc_flow", "bc_latent"])  # a kind each
def test_policies_act_in_the_world_and_are_loaded_with_their_frame(
    algorithm: str, data: Dataset, frame: Frame, tmp_path: Path
) -> None:
    policies = train_seeds(
        algorithm, data, tmp_path, seeds=(0, 1), config=config_of(algorithm, n_updates=3),
        frame=frame, progress=False,
    )  # fmt: skip
    assert read_run(tmp_path).frame == frame
    observations = data[0].observations[:4]
    for kept, policy in zip(load_run(tmp_path), policies, strict=True):
        assert isinstance(policy, TorchPolicy | ChoicePolicy | FlowPolicy | LatentPolicy)
        actions = acted(policy, observations)
        np.testing.assert_array_equal(acted(kept, observations), actions)
        assert actions.shape == (4, data.task.n_agents, 2)
        assert np.linalg.norm(actions, axis=-1).max() <= 1 + 1e-6
        world = dataclasses.replace(policy, frame=None)
        turned = frame.to_world(observations, acted(world, frame.inputs(observations)))
        norm = np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1)
        np.testing.assert_allclose(actions, turned / norm, atol=1e-6)


def test_a_run_keeps_its_frame_when_the_default_is_another(
    data: Dataset, frame: Frame, tmp_path: Path
) -> None:
    """So do runs of unicycles from before `auto` was their heading."""
    options: dict[str, Any] = {"seeds": (0,), "config": config_of("bc", n_updates=3)}
    (policy,) = train_seeds("bc", data, tmp_path, frame=None, progress=False, **options)
    assert data.frame == frame
    (loaded,) = load_run(tmp_path)
    observations = data[0].observations[:4]
    np.testing.assert_array_equal(acted(loaded, observations), acted(policy, observations))
    with pytest.raises(CheckpointError, match="frame"):
        train_seeds("bc", data, tmp_path, frame=frame, progress=False, **options)
