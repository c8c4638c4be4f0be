"""The team as one agent of Gymnasium plays the episodes of the vectorised world."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from swarmdata.envs.world.team_env import TeamEnv
from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.perception.frames import find_frame, in_world
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec

SPEC = TaskSpec(horizon=20)


@pytest.mark.filterwarnings("ignore:.*A Box observation space")  # without bounds
@pytest.mark.filterwarnings("ignore:.*gymnasium.make")  # it was not made by that
def test_passes_gymnasiums_check() -> None:
    check_env(TeamEnv(SPEC), skip_render_check=True)


@pytest.mark.parametrize("frame", ["world", "target"])
def test_an_episode_equals_the_vectorised_one(frame: str) -> None:
    """A policy acts in the frame as policies of this library do."""
    view, env = TeamEnv(SPEC, frame=frame), make_env(SPEC, 1)
    turn = find_frame(env.features, frame)
    observations, info = view.reset(seed=5)
    step = env.reset(np.array([5], np.uint64))
    rng = np.random.default_rng(0)
    while True:
        seen = step.observations if turn is None else turn.inputs(step.observations)
        for k, name in enumerate(SPEC.agent_names):
            np.testing.assert_array_equal(observations[name], seen[0, k])
            assert observations[name] in view.observation_space[name]
        np.testing.assert_array_equal(info["states"], step.states[0])
        if step.terminations.item() or step.truncations.item():
            break
        actions = rng.uniform(-1, 1, (1, SPEC.n_agents, 2)).astype(np.float32)
        mine = dict(zip(SPEC.agent_names, actions[0], strict=True))
        observations, reward, terminated, truncated, info = view.step(mine)
        world = in_world(turn, step.observations, actions.astype(np.float64))
        step = env.step(world.astype(np.float32))
        assert reward == pytest.approx(step.rewards.mean())
        assert (terminated, truncated) == (step.terminations.item(), step.truncations.item())
    assert info["success"] == step.successes.item()


def test_resets_play_the_reserved_episodes() -> None:
    reserved, free = TeamEnv(SPEC, reserved=True), TeamEnv(SPEC)
    for seed in evaluation_seeds(2).tolist():
        observations, _ = reserved.reset()
        expected, _ = free.reset(seed=seed)
        for name in SPEC.agent_names:
            np.testing.assert_array_equal(observations[name], expected[name])


def test_it_is_made_from_its_description() -> None:
    fields = {"spec": SPEC.model_dump(mode="json")}
    entry = f"{TeamEnv.__module__}:{TeamEnv.__qualname__}"
    text = EnvSpec("swarmdata/x-v1", entry_point=entry, kwargs=fields).to_json()
    made = gymnasium.make(EnvSpec.from_json(text), disable_env_checker=True)
    assert made.unwrapped.task == SPEC
    made.close()


def test_wrong_requests() -> None:
    with pytest.raises(SpecError, match="frame 'payload_goal' needs"):
        TeamEnv(SPEC, frame="payload_goal")
    with pytest.raises(SpecError, match="invalid TaskSpec in the spec"):
        TeamEnv({"horizon": -1})
    env = TeamEnv(SPEC, frame="target")
    env.reset(seed=0)
    with pytest.raises(SchemaError, match="no action for robot_1, robot_2, robot_3"):
        env.step({"robot_0": np.zeros(2, np.float32)})
