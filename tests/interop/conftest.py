"""Datasets to convert, and the check that every format's round trip has to pass."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import find_format
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import BoxSpace, DiscreteSpace
from swarmdata.testing.synthetic import make_dataset, make_episode
from swarmdata.types import END_REASONS, Episode
from tests.record.worlds import Seeing, record
from tests.support.made_episodes import stored

AGENTS = (
    RecordedAgent(
        name="adversary_0", observation=BoxSpace(shape=(5,), dtype="float32"),
        action=DiscreteSpace(n=5),
    ),
    RecordedAgent(
        name="agent_0", observation=BoxSpace(shape=(3,), dtype="float64"),
        action=BoxSpace(shape=(2,), dtype="float32", low=-1.0, high=1.5),
    ),
)  # fmt: skip
SPEC = RecordedSpec(task="tag_v3", agents=AGENTS, state_size=3, state_from="environment")
POLICIES = (PolicySource(label="mine", name="external"),)
RECORDING = Recording(id="tag_v3-mine-v0", spec=SPEC, policies=POLICIES, source="recorder")


def recorded_episode(length: int, seed: int) -> Episode:
    """Two different agents, the first of which leaves halfway.

    Every second episode is cut, every fourth although it succeeded.
    """
    episode = make_episode(length, seed, n_values=0, n_obstacles=0, n_features=5, n_states=3)
    steps = np.arange(length)
    last, leaves = steps == length - 1, steps == length // 2
    is_cut = bool(seed % 2)
    alive = np.ones((length + 1, 2), dtype=np.bool_)
    alive[1:, 0] = ~np.logical_or.accumulate(leaves)
    observations, actions = episode.observations.copy(), episode.actions.copy()
    observations[:, 1, 3:] = 0
    observations[:, 0] *= alive[:, :1]
    actions[:, 0, 0] = (steps + seed) % 4 * alive[:-1, 0]
    actions[:, 0, 1] = 0
    masks = np.ones((length + 1, 2, 5), dtype=np.bool_)
    masks[:, 0, 4] = False
    return replace(
        episode,
        observations=observations,
        actions=actions,
        rewards=episode.rewards * alive[:-1],
        events=episode.events[..., :0],
        log_probs=episode.log_probs[:, :0],
        end_reason=END_REASONS.index(("ended", "horizon", "ended", "success")[seed % 4]),
        terminations=last & (not is_cut),
        truncations=last & is_cut,
        alive=alive,
        action_masks=masks,
        agent_terminations=np.stack([leaves, last & (not is_cut)], 1),
        agent_truncations=np.stack([np.zeros_like(last), last & is_cut], 1),
    )


def recorded_episodes(lengths: Iterable[int]) -> list[Episode]:
    return [recorded_episode(length, seed) for seed, length in enumerate(lengths)]


def write_recording(folder: Path, episodes: Sequence[Episode]) -> Dataset:
    splits = np.arange(len(episodes), dtype=np.uint8) % 3
    return stored(folder / "recorded", RECORDING, [episodes], splits)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A recording of different agents, one of which leaves, with masks of actions."""
    episodes = recorded_episodes([3, 5, 2, 4, 6, 2, 3])
    return write_recording(tmp_path_factory.mktemp("recorded"), episodes)


@pytest.fixture(scope="session")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A dataset of a task of this library, by two policies, with messages and obstacles."""
    folder = tmp_path_factory.mktemp("ours") / "ours"
    make_dataset(folder, [[4, 3, 5, 2, 4, 3] * 2, [2, 4, 3, 6] * 3], n_steps=40)
    return Dataset.open(folder)


@pytest.fixture(scope="session")
def images(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A recording of two agents that observe images of bytes."""
    return record(Seeing(), tmp_path_factory.mktemp("images") / "ds", 8)


@dataclass(frozen=True)
class Taken:
    """What a reader gave, without a dataset being written."""

    spec: Any
    metadata: Mapping[str, str]
    episodes: list[Episode]

    @property
    def lengths(self) -> list[int]:
        return [len(episode) for episode in self.episodes]

    @property
    def ends(self) -> list[str]:
        return [END_REASONS[episode.end_reason] for episode in self.episodes]


@pytest.fixture
def take_in() -> Callable[..., Taken]:
    """Reads foreign data with some choices."""

    def take(path: Path, name: str, **answers: Any) -> Taken:
        read = find_format(name).read
        assert read is not None
        with read(path, "maze", Choices(**answers)) as incoming:
            return Taken(incoming.spec, incoming.metadata, list(incoming.episodes))

    return take
