"""Files of OMAR's layout are converted, learned from and played in a world of its interface."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from tests.benchmarks.bench_omar_data import (
    EXPERT,
    PAPER,
    RANDOM,
    convert,
    main,
    measure,
    normalized,
)
from tests.benchmarks.peers.particle_world import FOLDER, STEPS, ParticleWorld
from tests.benchmarks.peers.team_data import Budget

SCENARIO = """
class Scenario:
    def make_world(self):
        print("two agents")
        return [0.0, 0.0]

    reset_world = reward = observation = None
"""

ENVIRONMENT = """
import numpy as np
from gym import Env, spaces

class MultiAgentEnv(Env):
    def __init__(self, world, reset, reward, observation):
        self.n, self.world = len(world), world
        self.action_space = [spaces.Box(-1.0, 1.0, (2,))] * self.n
        self.observation_space = [spaces.Box(-np.inf, np.inf, (3,))] * self.n

    def _reset(self):
        self._reset_render()
        self.goals = np.random.uniform(-1, 1, (self.n, 2))
        return self._seen()

    def _seen(self):
        return [np.append(goal, 1.0) for goal in self.goals]

    def _step(self, actions):
        rewards = [20 - 10 * np.abs(a - g).mean() for a, g in zip(actions, self.goals)]
        self.goals = np.random.uniform(-1, 1, (self.n, 2))
        return self._seen(), rewards, [False] * self.n, {}
"""
"""A world of ours with the interface of theirs: an action should equal what is observed."""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    scenarios = tmp_path / "omar" / FOLDER / "multiagent" / "scenarios"
    scenarios.mkdir(parents=True)
    (scenarios.parent / "__init__.py").write_text("from gym.envs.registration import register\n")
    (scenarios.parent / "environment.py").write_text(ENVIRONMENT)
    (scenarios / "__init__.py").write_text("")
    (scenarios / "simple_spread.py").write_text(SCENARIO)
    return tmp_path / "omar"


def write_run(folder: Path, world: ParticleWorld, n_episodes: int, flag: float) -> float:
    """Good actions with noise, in files of their layout; returns the mean return."""
    rng, agents = np.random.default_rng(0), world.possible_agents
    columns: dict[str, list[list[object]]] = {
        name: [[] for _ in agents] for name in ("obs", "acs", "rews", "next_obs", "dones")
    }
    returns = []
    for episode in range(n_episodes):
        seen, _ = world.reset(seed=episode)
        returns.append(0.0)
        for time in range(STEPS):
            chosen = {
                agent: (seen[agent][:2] + rng.normal(0, 0.1, 2)).clip(-1, 1) for agent in seen
            }
            following, rewards, _, truncations, _ = world.step(chosen)
            assert all(truncations.values()) == (time == STEPS - 1)
            returns[-1] += np.mean(list(rewards.values()))
            for k, agent in enumerate(agents):
                done = flag * (time == STEPS - 1)
                row = (seen[agent], chosen[agent], rewards[agent], following[agent], done)
                for name, value in zip(columns, row, strict=True):
                    columns[name][k].append(value)
            seen = following
    folder.mkdir(parents=True)
    for name, by_agent in columns.items():
        for k, values in enumerate(by_agent):
            np.save(folder / f"{name}_{k}.npy", np.array(values))
    return float(np.mean(returns))


@pytest.mark.parametrize("flag", [0.0, 1.0], ids=["without flags", "with flags"])
def test_ends_of_episodes_are_truncations(tmp_path: Path, checkout: Path, flag: float) -> None:
    world = ParticleWorld(checkout)
    means = [write_run(tmp_path / f"medium/seed_{k}_data", world, 20, flag=flag) for k in range(2)]
    dataset = convert(tmp_path / "medium", "medium-replay", tmp_path / "out")
    assert dataset.id.startswith("simple_spread-omar_medium_replay-v0")
    assert len(dataset) == 40
    assert {len(episode) for episode in dataset} == {STEPS}
    assert all(e.truncations[-1] and not e.terminations.any() for e in dataset)
    assert dataset.episodes.team_return.mean() == pytest.approx(np.mean(means), rel=1e-5)


@pytest.mark.slow
def test_a_clone_is_as_good_as_good_data(tmp_path: Path, checkout: Path) -> None:
    world = ParticleWorld(checkout)
    recorded = write_run(tmp_path / "data/simple_spread/expert/seed_0_data", world, 60, flag=0.0)
    budget = Budget(n_updates=400, batch_size=128, units=32, n_seeds=2, n_episodes=5)
    page = measure(tmp_path / "data", checkout, ["bc"], budget)
    cells = {
        parts[0].strip("| "): parts[1].strip()
        for parts in (line.strip("| ").split(" | ") for line in page.splitlines() if "|" in line)
    }
    assert float(cells["recorded episodes"]) == pytest.approx(normalized(np.array(recorded)), abs=1)
    clone = float(cells["ours, `bc`"].split()[0])
    assert clone > float(cells["recorded episodes"]) - 5
    assert cells["published: OMAR"] == str(PAPER["OMAR"][0])


def test_the_ends_of_the_score() -> None:
    assert normalized(np.array([RANDOM, EXPERT])).tolist() == [0.0, 100.0]


def test_a_folder_without_data_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="none of the folders expert"):
        measure(tmp_path, tmp_path, ["bc"], Budget())


def test_without_data_nothing_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench_omar_data"])
    for name in ("OMAR_DATA", "OMAR"):
        monkeypatch.delenv(name, raising=False)
    main()
    assert capsys.readouterr().out.count("\n") == 1
