"""The PettingZoo view passes PettingZoo's own tests and equals the vectorised world."""

import warnings

import numpy as np
import pytest

from swarmdata.envs.world.pettingzoo import ParallelWorld
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.registry.components import TASKS, make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec

with warnings.catch_warnings():
    # pettingzoo.test imports its classic games through an interface that it deprecated itself
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test, parallel_seed_test


MODELS = [
    ("state", "none"),
    ("state+noise-0.1+dropout-0.2", "perfect"),
    ("lidar", "lossy-30+delayed-2"),
    ("bearing", "goal+nearest-2+bits-6"),
    ("occupancy+stack-2+delay-1", "bursty-20+range-1.5"),
    ("lidar", "learned-3+aloha-4"),
    ("state-0+goal-for-5", "errand+lossy-30+expires-3"),
    ("bearing+no-velocities+stack-2", "none"),
    ("state+ways+goal-for-5+delay-2+noise-0.05", "errand+lossy-30"),
    ("lidar+ways+stack-2", "none"),
]


WORLDS = [name for name in preset_names() if name in TASKS]
CASES = [(WORLDS[0], models) for models in MODELS] + list(zip(WORLDS[1:], MODELS[1:], strict=False))
"""All models in one world, and every other world with models of its own."""


@pytest.mark.parametrize(("world", "models"), CASES)
def test_passes_pettingzoo_api_test(world: str, models: tuple[str, str]) -> None:
    spec = with_models(preset(world).with_updates(horizon=25), *models)
    parallel_api_test(ParallelWorld(spec), num_cycles=60)


@pytest.mark.parametrize(("world", "models"), CASES)
def test_passes_pettingzoo_seed_test(world: str, models: tuple[str, str]) -> None:
    spec = with_models(preset(world), *models)
    parallel_seed_test(lambda: ParallelWorld(spec), num_cycles=30)


def test_pictures_show_rays_and_messages() -> None:
    pytest.importorskip("PIL", reason="Pillow draws")
    pictures = []
    for models in (("state", "none"), ("lidar", "none"), ("lidar", "perfect")):
        view = ParallelWorld(with_models(TaskSpec(), *models), render_mode="rgb_array")
        view.reset(seed=3)
        pictures.append(np.asarray(view.render()))
    assert np.any(pictures[0] != pictures[1])
    assert np.any(pictures[1] != pictures[2])
    assert ParallelWorld(TaskSpec()).render() is None


def test_an_episode_equals_the_vectorised_one() -> None:
    view, env = ParallelWorld(TaskSpec(horizon=40)), make_env(TaskSpec(horizon=40), 1)
    observations, _ = view.reset(seed=5)
    step = env.reset(np.array([5], dtype=np.uint64))
    rng = np.random.default_rng(0)
    while view.agents:
        np.testing.assert_array_equal(np.stack(list(observations.values())), step.observations[0])
        np.testing.assert_array_equal(view.state(), step.states[0])
        actions = rng.uniform(-1, 1, (4, 2)).astype(np.float32)
        observations, rewards, terminations, truncations, infos = view.step(
            dict(zip(view.possible_agents, actions, strict=True))
        )
        step = env.step(actions[None])
        np.testing.assert_array_equal(list(rewards.values()), step.rewards[0].astype(float))
    assert step.truncations[0]
    assert all(truncations.values())
    assert not any(terminations.values())
    assert set(infos) == set(view.possible_agents)


def test_wrong_use_is_refused() -> None:
    view = ParallelWorld(TaskSpec())
    with pytest.raises(SchemaError, match=r"call reset\(\) first"):
        view.step({})
    view.reset(seed=1)
    right = dict.fromkeys(view.agents, np.zeros(2, np.float32))
    with pytest.raises(SchemaError, match="no action for robot_1, robot_2, robot_3"):
        view.step({"robot_0": np.zeros(2, np.float32)})
    for wrong in (dict.fromkeys(view.agents, np.zeros(3)), {**right, "robot_1": "x"}, None):
        with pytest.raises(SchemaError, match="with an array of 2 numbers for each of"):
            view.step(wrong)  # type: ignore[arg-type]
    for seed in (-1, 2**64, 1.5, "3", True):
        with pytest.raises(SchemaError, match="the seeds are"):
            view.reset(seed=seed)  # type: ignore[arg-type]
    view.step(right)  # the episode goes on
    with pytest.raises(SpecError, match="render_mode 'human' is unknown"):
        ParallelWorld(TaskSpec(), render_mode="human")


def test_make_env_builds_it_and_both_kinds_can_be_closed() -> None:
    env = make_env(TaskSpec(), api="pettingzoo", render_mode="rgb_array")
    observations, _ = env.reset(seed=3)
    assert list(observations) == list(TaskSpec().agent_names)
    assert env.render().shape[2] == 3
    with pytest.raises(SchemaError, match="which is of api pettingzoo"):
        make_env(TaskSpec(), render_mode="rgb_array")  # type: ignore[call-overload]
    env.close()
    copies = make_env(TaskSpec(), 2)
    copies.close()
    with pytest.raises(SchemaError, match="1 copy and 1 thread, got n_copies=2"):
        make_env(TaskSpec(), 2, api="pettingzoo")
    with pytest.raises(UnknownNameError, match="gym"):
        make_env(TaskSpec(), api="gym")  # type: ignore[call-overload]
