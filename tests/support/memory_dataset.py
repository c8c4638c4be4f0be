"""MemoryDataset, a few episodes in memory that can be trained on like a stored dataset."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.sampling import Rows, Sampler
from swarmdata.numerics.random import derive, uniform
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import STEP_FIELDS, Double, Episode, Int, Seeds


@dataclass(frozen=True, slots=True, eq=False)
class MemoryMoments:
    """Mean and standard deviation of every observation feature over agents and time."""

    observation_mean: Double  # [O]
    observation_std: Double  # [O]


@dataclass(frozen=True)
class MemoryDataset:
    """Episodes in memory, at least one, with the part of `Dataset` that training uses."""

    episodes: Sequence[Episode]
    spec: TaskSpec = field(default_factory=TaskSpec)
    id: str = "memory-v0"
    digest: str = "0" * 64
    view: str | None = None  # changed models and reward weights as JSON

    @property
    def own_spec(self) -> TaskSpec:
        return self.spec

    def __len__(self) -> int:
        return len(self.episodes)

    def __iter__(self) -> Iterator[Episode]:
        return iter(self.episodes)

    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        return (tuple(getattr(episode, name) for name in names) for episode in self)

    def filter(self, *, min_return: float) -> "MemoryDataset":
        kept = [episode for episode in self.episodes if episode.team_return >= min_return]
        return replace(self, episodes=kept)

    @cached_property
    def moments(self) -> MemoryMoments:
        rows = np.concatenate([e.observations.reshape(-1, e.observations.shape[-1]) for e in self])
        return MemoryMoments(rows.mean(0, dtype=np.float64), rows.std(0, dtype=np.float64))

    @cached_property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """As a stored dataset has them, one episode after the other."""
        names = ("observations", "states", *STEP_FIELDS)
        return {name: np.concatenate([getattr(e, name) for e in self]) for name in names}

    @cached_property
    def rows(self) -> Rows:
        lengths = np.array([len(episode) for episode in self], dtype=np.int64)
        ends = lengths.cumsum()
        episode = np.repeat(np.arange(len(lengths)), lengths)
        valid, positions = np.arange(len(episode)), np.arange(len(lengths))
        return Rows(episode, ends - lengths, ends, valid=valid, positions=positions)

    @cached_property
    def transitions(self) -> dict[str, NDArray[Any]]:
        """All transitions, field by field."""
        batch = self.sampler().gather(self.rows.valid)
        found = {each.name: getattr(batch, each.name) for each in fields(batch)}
        return {name: values for name, values in found.items() if values is not None}

    def sampler(self, batch_size: int = 256, **settings: Any) -> "MemorySampler":
        """An endless stream of batches, as `Dataset.sampler` gives it."""
        chosen: Any = {"batch_size": batch_size, "rows": self.rows, **settings}
        return MemorySampler(self.arrays, None, np.arange(len(self)), **chosen)  # type: ignore[arg-type]


class MemorySampler(Sampler):
    """Draws by the random numbers for which the thresholds of tests of learning were set."""

    def _drawn(self, numbers: Seeds) -> Int:
        return self.pick(uniform(derive(self.seed, numbers)))
