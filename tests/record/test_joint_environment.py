"""Recordings of AEC environments and of Gymnasium's: the joint steps that they take."""

import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from pettingzoo import AECEnv
from pettingzoo.utils.conversions import aec_to_parallel_wrapper, parallel_to_aec

import swarmdata
from swarmdata.errors import SpecError
from swarmdata.record import Recorder, evaluate_parallel, foreign_evaluation_seeds
from swarmdata.record.joint_environment import SINGLE_AGENT
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.specs.spaces import BoxSpace, DiscreteSpace
from tests.record.worlds import Counting, play, record, spec_of, steady


class Turns(AECEnv):  # type: ignore[misc]
    """Two agents that act one after the other; the world counts after the second.

    Args:
        is_parallelizable: whether it says so.
    """

    def __init__(self, is_parallelizable: bool) -> None:
        self.metadata = {"name": "turns_v0", "is_parallelizable": is_parallelizable}
        self.possible_agents = ["first", "second"]
        self.render_mode = None

    def observation_space(self, agent: str) -> Any:
        return gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)

    def action_space(self, agent: str) -> Any:
        return gymnasium.spaces.Discrete(3)

    def observe(self, agent: str) -> Any:
        return np.array([self.time, self.possible_agents.index(agent)], np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.time, self.agents = 0, list(self.possible_agents)
        self.agent_selection, self.chosen = self.agents[0], dict[str, int]()
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {agent: {} for agent in self.agents}

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent]:
            self._was_dead_step(action)
            return
        self.chosen[agent] = int(action)
        self._clear_rewards()
        if agent == self.agents[-1]:
            self.time += 1
            self.rewards = {name: 10.0 * self.time + self.chosen[name] for name in self.agents}
            self.terminations = dict.fromkeys(self.agents, self.time == 3)
        turn = (self.agents.index(agent) + 1) % len(self.agents)
        self.agent_selection = self.agents[turn]


def test_a_cycle_of_an_aec_environment_is_a_joint_step(tmp_path: Path) -> None:
    dataset = record(Turns(is_parallelizable=True), tmp_path / "ds", 6)
    assert dataset.spec.agent_names == ("first", "second")
    for episode in dataset:
        time = np.arange(4)
        assert len(episode) == 3
        np.testing.assert_array_equal(episode.observations[:, 0, 0], time)
        np.testing.assert_array_equal(episode.observations[:, 1, 1], 1)
        expected = 10 * time[1:, None] + episode.actions[:, :, 0]
        np.testing.assert_array_equal(episode.rewards, expected)
        assert episode.terminations.tolist() == [False, False, True]


@pytest.mark.slow
def test_the_same_environment_both_ways_is_one_dataset(tmp_path: Path) -> None:
    module = pytest.importorskip("mpe2.simple_spread_v3", reason="an AEC environment of others")
    made = [
        record(make(max_cycles=7), tmp_path / str(k), 6, task="simple_spread_v3")
        for k, make in enumerate((module.env, module.parallel_env))
    ]
    assert made[0].digest == made[1].digest
    assert made[0].spec == made[1].spec
    assert made[0].spec.library == "mpe2"


def test_a_wrapped_parallel_environment_is_unwrapped(tmp_path: Path) -> None:
    inner: Any = Counting()
    inner.render_mode = None
    turns = parallel_to_aec(inner)
    with Recorder(turns, id="counting_v1-mine-v0", path=tmp_path / "ds") as recorder:
        play(recorder, 6, steady)
    assert recorder.unwrapped is inner


def test_agents_that_act_in_turns_are_refused(tmp_path: Path) -> None:
    turns = [Turns(is_parallelizable=False)]
    with warnings.catch_warnings():  # PettingZoo announces another way to make environments
        warnings.simplefilter("ignore", DeprecationWarning)
        turns.append(import_module("pettingzoo.classic.tictactoe_v3").env())
    for env in turns:
        with pytest.raises(SpecError, match="cannot be recorded, because its agents act in turns"):
            Recorder(env, id="turns_v0-mine-v0", path=tmp_path / "ds")
        with pytest.raises(AssertionError, match="not generally safe"):
            aec_to_parallel_wrapper(env)  # PettingZoo says the same


def test_copies_of_gymnasium_are_refused(tmp_path: Path) -> None:
    copies = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    with pytest.raises(SpecError, match="is a Gymnasium VectorEnv"):
        Recorder(copies, id="cartpole_v1-mine-v0", path=tmp_path / "ds")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "task", "horizon"),
    [("CartPole-v1", "cartpole_v1", 500), ("Pendulum-v1", "pendulum_v1", 200)],
)
def test_an_environment_of_gymnasium_is_one_agent(
    name: str, task: str, horizon: int, tmp_path: Path
) -> None:
    """What passed is what was recorded: the same seeds and actions give the same numbers again."""
    dataset = record(gymnasium.make(name), tmp_path / "ds", 5, id=f"{task}-mine-v0", task=None)
    env, spec = gymnasium.make(name), spec_of(dataset)
    assert (spec.task, spec.library, spec.horizon) == (task, "gymnasium", horizon)
    assert (spec.agent_names, spec.state_from) == ((SINGLE_AGENT,), "observations")
    for episode in dataset:
        seen, _ = env.reset(seed=episode.seed)
        for t, action in enumerate(episode.actions[:, 0]):
            np.testing.assert_array_equal(episode.observations[t, 0], seen.astype(np.float32))
            given = int(action[0]) if name == "CartPole-v1" else action
            seen, reward, terminated, truncated, _ = env.step(given)
            assert episode.rewards[t, 0] == np.float32(reward)
            assert (episode.terminations[t], episode.truncations[t]) == (terminated, truncated)
        assert terminated or truncated
    expected = DiscreteSpace if name == "CartPole-v1" else BoxSpace
    assert isinstance(spec.agents[0].action, expected)


@pytest.mark.slow
def test_a_policy_plays_gymnasium(tmp_path: Path) -> None:
    dataset = record(gymnasium.make("Pendulum-v1"), tmp_path / "ds", 4, task="pendulum_v1")
    policy = FunctionPolicy(
        lambda observations: np.zeros((*observations.shape[:2], 1), np.float32), units="unit"
    )
    result = evaluate_parallel(
        policy, lambda: gymnasium.make("Pendulum-v1"), spec_of(dataset), foreign_evaluation_seeds(2)
    )
    assert result.metrics["length"].tolist() == [200, 200]
    assert swarmdata.load(dataset.path).n_episodes == 4
