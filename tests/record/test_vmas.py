"""All copies of a VMAS environment become episodes."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import BuildError, SchemaError, SpecError
from swarmdata.record import Limits, record_vmas
from swarmdata.types import END_REASONS
from tests.record.worlds import spec_of

ID = "halving-mine-v0"


class Box:
    """Like that of the old gym, which VMAS still uses."""

    def __init__(self, low: float, high: float, n: int) -> None:
        self.low, self.high = np.full(n, low, np.float32), np.full(n, high, np.float32)
        self.shape, self.dtype = (n,), np.dtype(np.float32)


class Scenario:
    def make_world(self) -> None:
        """Names the scenario by its file."""


class Halving:
    """A stand-in for `vmas.simulator.environment.Environment`: positions that commands move.

    A copy ends once its first agent is near 0, which depends on the seed and the copy.
    """

    def __init__(self, num_envs: int = 4, max_steps: int | None = 5, flags: bool = True) -> None:
        self.num_envs, self.max_steps, self.terminated_truncated = num_envs, max_steps, flags
        self.agents, self.dict_spaces = [SimpleNamespace(name=name) for name in "ab"], False
        self.observation_space = [Box(-np.inf, np.inf, 3), Box(-np.inf, np.inf, 2)]
        self.action_space = [Box(-1, 1, 1), Box(-1, 1, 2)]
        self.scenario = Scenario()
        self.seeds: list[int] = []

    def reset(self, seed: int) -> list[Any]:
        self.seeds.append(seed)
        self.time = 0
        self.place = (1 + (seed + np.arange(self.num_envs)) % 7).astype(np.float32)
        return self._observe()

    def step(self, actions: list[Any]) -> tuple[Any, ...]:
        self.time += 1
        self.place = self.place / np.float32(2)
        for action in actions:
            action.fill(0)  # VMAS may write to what it was given
        ended = self.place < 0.3
        cut = np.full(self.num_envs, self.time >= (self.max_steps or 0))
        infos = [{"success": ended}, {}]
        rewards = [self.place.copy(), self.place.reshape(-1, 1)]  # `wheel` has the second shape
        return self._observe(), rewards, ended, cut, infos

    def _observe(self) -> list[Any]:
        a = np.stack([self.place, np.full(self.num_envs, self.time), self.place * 0], 1)
        return [a.astype(np.float32), a[:, :2].astype(np.float32)]


def act(observations: list[Any]) -> list[Any]:
    return [observations[0][:, :1] / 100, observations[1] / 100]


def test_every_copy_is_an_episode_with_its_own_end(tmp_path: Path) -> None:
    env = Halving()
    dataset = record_vmas(env, act, 10, id=ID, path=tmp_path / "ds", task="halving")
    assert dataset.n_episodes == 10
    assert len(env.seeds) == 3
    spec = spec_of(dataset)
    assert (spec.horizon, spec.state_size, spec.options) == (5, 5, {"num_envs": 4})
    for index, episode in enumerate(dataset):
        seed, copy = env.seeds[index // 4], index % 4
        assert episode.seed == seed * 4 + copy
        start = 1 + (seed + copy) % 7
        places = np.float32(start) / 2.0 ** np.arange(len(episode) + 1)
        np.testing.assert_array_equal(episode.observations[:, 0, 0], places)
        np.testing.assert_array_equal(episode.observations[:, 1, 1], np.arange(len(episode) + 1))
        np.testing.assert_allclose(episode.actions[:, 1, 0], places[:-1] / 100)
        assert not episode.actions[:, 0, 1].any(), "padding"
        np.testing.assert_array_equal(episode.rewards, np.stack([places[1:]] * 2, 1))
        assert (places[:-1] >= 0.3).all()
        solved = bool(places[-1] < 0.3)
        assert END_REASONS[episode.end_reason] == ("success" if solved else "horizon")
        assert bool(episode.terminations[-1]) == solved
        plain = [episode.observations[:, 0], episode.observations[:, 1, :2]]
        np.testing.assert_array_equal(episode.states, np.concatenate(plain, 1))


@pytest.mark.parametrize(("written", "resets"), [(4, 2), (3, 3)])  # a whole batch, a part of it
def test_it_goes_on_where_it_was_interrupted(tmp_path: Path, written: int, resets: int) -> None:
    calls = 0

    def failing(observations: list[Any]) -> list[Any]:
        nonlocal calls
        calls += 1
        if calls > 8:
            raise KeyboardInterrupt
        return act(observations)

    options: dict[str, Any] = {"id": ID, "path": tmp_path / "ds", "task": "halving"}
    with pytest.raises(KeyboardInterrupt):
        record_vmas(Halving(), failing, 12, **options, limits=Limits(episodes=written))
    env = Halving()
    dataset = record_vmas(env, act, 12, **options)
    assert len(env.seeds) == resets, "the first episodes were kept"
    whole = record_vmas(Halving(), act, 12, id=ID, path=tmp_path / "whole", task="halving")
    assert dataset.digest == whole.digest
    with pytest.raises(BuildError, match="exists"):
        record_vmas(env, act, 12, **options)


@pytest.mark.parametrize("wrong", [{"max_steps": None}, {"flags": False}])
def test_a_horizon_that_cannot_be_told_from_an_end_is_refused(
    tmp_path: Path, wrong: dict[str, Any]
) -> None:
    """VMAS merges both into `done` by default."""
    with pytest.raises(SpecError, match="terminated_truncated=True"):
        record_vmas(Halving(**wrong), act, 4, id=ID, path=tmp_path / "ds", task="halving")


def test_wrong_shapes_and_values_are_refused(tmp_path: Path) -> None:
    options: dict[str, Any] = {"id": ID, "path": tmp_path / "ds", "task": "halving"}
    for wrong, words in (
        (np.full((4, 1), np.nan), "action of a is not finite"),
        (np.full((4, 1), 1e39), "action of a is not finite"),
        (np.zeros((4, 2)), r"action of a has shape \(4, 2\), expected 1 numbers in each of 4"),
    ):
        with pytest.raises(SchemaError, match=words):
            record_vmas(Halving(), lambda _, wrong=wrong: [wrong, wrong], 4, **options)  # type: ignore[misc]
    with pytest.raises(SpecError, match="play the same policy"):
        record_vmas(Halving(), act, 4, **options, policies=("a", "b"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # VMAS imports gym, which is not maintained
@pytest.mark.parametrize(
    ("scenario", "options"),
    [
        ("navigation", {"n_agents": 3}),
        ("wheel", {}),
        ("simple_tag", {}),
        ("balance", {"n_agents": 2, "continuous_actions": False}),
    ],
)
def test_vmas_itself(scenario: str, options: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("torch")
    vmas = pytest.importorskip("vmas")
    env = vmas.make_env(scenario, 6, max_steps=12, terminated_truncated=True, seed=0, **options)
    seen: list[Any] = []

    def random(observations: list[Any]) -> list[Any]:
        actions = env.get_random_actions()
        seen.append([[o.numpy().copy() for o in observations], [a.numpy().copy() for a in actions]])
        return list(actions)

    dataset = record_vmas(env, random, 12, id=f"{scenario}-random-v0", path=tmp_path / "ds")
    spec = spec_of(dataset)
    assert (spec.task, spec.library) == (scenario, "vmas")
    episode = dataset[0]
    for time in range(len(episode)):
        for agent in range(spec.n_agents):
            observation, action = seen[time][0][agent][0], np.ravel(seen[time][1][agent][0])
            own = episode.observations[time, agent, : len(observation)]
            np.testing.assert_array_equal(own, observation)
            np.testing.assert_array_equal(episode.actions[time, agent, : len(action)], action)
