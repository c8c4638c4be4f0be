"""Recorder over environments of others: what the environment gave is what the dataset holds."""

import os
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.record import Recorder
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.spaces import flatten

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # pygame, which these environments import

QUICK = ("mpe2.simple_spread_v3", {"continuous_actions": True, "max_cycles": 7})
OTHERS: list[tuple[str, dict[str, Any]]] = [
    ("mpe2.simple_spread_v3", {"max_cycles": 7}),
    ("mpe2.simple_adversary_v3", {"max_cycles": 7}),
    ("mpe2.simple_crypto_v3", {"max_cycles": 7}),
    ("mpe2.simple_push_v3", {"max_cycles": 7, "continuous_actions": True}),
    ("mpe2.simple_reference_v3", {"max_cycles": 7}),
    ("mpe2.simple_speaker_listener_v4", {"max_cycles": 7, "continuous_actions": True}),
    ("mpe2.simple_tag_v3", {"max_cycles": 7}),
    ("mpe2.simple_world_comm_v3", {"max_cycles": 7}),
    ("pettingzoo.sisl.multiwalker_v9", {"max_cycles": 20, "n_walkers": 2}),
    ("pettingzoo.sisl.pursuit_v5", {"max_cycles": 7}),
]


def make(name: str, options: dict[str, Any]) -> Any:
    with warnings.catch_warnings():  # PettingZoo announces another way to make environments
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            module = import_module(name)
        except ImportError as error:
            pytest.skip(f"{name} is not installed: {error}")
        return module.parallel_env(**options)


class Witness:
    """Keeps its own flat copies of what passes."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder, self.spec = recorder, recorder._recording.spec
        assert isinstance(self.spec, RecordedSpec)
        self.agents = self.spec.agents
        self.episodes: list[dict[str, list[Any]]] = []

    def play(self, n_episodes: int) -> None:
        for k in range(n_episodes):
            observations, _ = self.recorder.reset(seed=k)
            found: dict[str, list[Any]] = {"observations": [], "actions": [], "rewards": []}
            self.episodes.append(found)
            found["observations"].append(self.flat(observations, "observation"))
            while self.recorder.agents:
                actions = {
                    agent: self.recorder.action_space(agent).sample()
                    for agent in self.recorder.agents
                }
                found["actions"].append(self.flat(actions, "action"))
                observations, rewards, *_ = self.recorder.step(actions)
                found["rewards"].append({str(k): float(v) for k, v in rewards.items()})
                found["observations"].append(self.flat(observations, "observation"))

    def flat(self, values: dict[Any, Any], kind: str) -> dict[str, Any]:
        spaces = {agent.name: getattr(agent, kind) for agent in self.agents}
        return {str(k): flatten(spaces[str(k)], v, "here") for k, v in values.items()}


def check(dataset: Dataset, witness: Witness) -> None:
    spec = dataset.spec
    assert isinstance(spec, RecordedSpec)
    assert dataset.n_episodes == len(witness.episodes)
    for episode, seen in zip(dataset, witness.episodes, strict=True):
        assert len(episode) == len(seen["actions"])
        for name in ("observations", "actions"):
            for row, values in zip(getattr(episode, name), seen[name], strict=True):
                for agent, own in zip(spec.agents, row, strict=True):
                    given = values.get(agent.name, np.zeros(0, np.float32))
                    np.testing.assert_array_equal(own[: len(given)], given)
                    assert not own[len(given) :].any()
        for row, values in zip(episode.rewards, seen["rewards"], strict=True):
            expected = [values.get(agent.name, 0.0) for agent in spec.agents]
            np.testing.assert_array_equal(row, np.array(expected, np.float32))
        assert episode.states.shape[1] == spec.state_size
        assert bool(episode.terminations[-1]) != bool(episode.truncations[-1])


def record(path: Path, name: str, options: dict[str, Any], n_episodes: int) -> Dataset:
    task = name.rpartition(".")[2]
    env = make(name, options)
    # the state of multiwalker_v9 cannot be asked for once its walkers are gone
    state: Literal["auto", "observations"] = "observations" if "walker" in name else "auto"
    with Recorder(
        env, id=f"{task}-random-v0", path=path, task=task, options=options, state=state
    ) as recorder:
        for agent in env.possible_agents:
            env.action_space(agent).seed(0)
        witness = Witness(recorder)
        witness.play(n_episodes)
    dataset = recorder.close()
    check(dataset, witness)
    return dataset


def test_simple_spread(tmp_path: Path) -> None:
    dataset = record(tmp_path / "ds", *QUICK, n_episodes=6)
    spec = dataset.spec
    assert isinstance(spec, RecordedSpec)
    assert (spec.library, spec.horizon) == ("mpe2", 7)
    assert spec.version
    assert dataset.episodes.seeds.tolist() == list(range(6))
    assert set(dataset.episodes.end_reason.tolist()) == {2}, "the horizon"
    batch = next(dataset.sampler(64))
    assert -1 <= batch.actions.min() < -0.5 < 0.5 < batch.actions.max() <= 1


@pytest.mark.slow
@pytest.mark.parametrize(("name", "options"), OTHERS, ids=[name for name, _ in OTHERS])
def test_environments_of_others(name: str, options: dict[str, Any], tmp_path: Path) -> None:
    dataset = record(tmp_path / "ds", name, options, n_episodes=6)
    assert name.rpartition(".")[2] in dataset.card


@pytest.mark.slow
def test_the_same_seeds_and_actions_give_the_same_recording(tmp_path: Path) -> None:
    one, other = (record(tmp_path / where, *QUICK, n_episodes=4) for where in ("a", "b"))
    assert one.digest == other.digest
