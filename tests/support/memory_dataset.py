"""MemoryDataset, a few episodes in memory that can be trained on like a stored dataset."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.sampling import BatchStream, Rows
from swarmdata.numerics.event_costs import costs_of
from swarmdata.numerics.random import derive, uniform
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Batch, Bool, Double, Episode, Int, Seeds, Wanted


@dataclass(frozen=True, slots=True, eq=False)
class MemoryMoments:
    """Mean and standard deviation of every observation feature over agents and time."""

    observation_mean: Double  # [O]
    observation_std: Double  # [O]


@dataclass(frozen=True)
class MemoryDataset:
    """Episodes in memory, with the part of `Dataset` that training uses.

    Attributes:
        episodes: at least one.
        spec: the task.
        id: name of the dataset.
        digest: stands for the content.
        view: changed models and reward weights as JSON.
    """

    episodes: Sequence[Episode]
    spec: TaskSpec = field(default_factory=TaskSpec)
    id: str = "memory-v0"
    digest: str = "0" * 64
    view: str | None = None

    @property
    def own_spec(self) -> TaskSpec:
        """The task."""
        return self.spec

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.episodes)

    def __iter__(self) -> Iterator[Episode]:
        """Yields the episodes."""
        return iter(self.episodes)

    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        """Yields some arrays of each episode."""
        return (tuple(getattr(episode, name) for name in names) for episode in self)

    def filter(self, *, min_return: float) -> "MemoryDataset":
        """Returns the episodes of at least this team return."""
        kept = [episode for episode in self.episodes if episode.team_return >= min_return]
        return replace(self, episodes=kept)

    @cached_property
    def moments(self) -> MemoryMoments:
        """Moments of the observations."""
        rows = np.concatenate([e.observations.reshape(-1, e.observations.shape[-1]) for e in self])
        return MemoryMoments(rows.mean(0, dtype=np.float64), rows.std(0, dtype=np.float64))

    @cached_property
    def transitions(self) -> dict[str, NDArray[Any]]:
        """All transitions, field by field; the next state is never another episode's."""
        columns: dict[str, list[Any]] = {}
        for position, e in enumerate(self):
            columns_of = {
                "observations": e.observations[:-1],
                "next_observations": e.observations[1:],
                "states": e.states[:-1],
                "next_states": e.states[1:],
                "actions": e.actions,
                "rewards": e.rewards,
                "terminations": e.terminations,
                "truncations": e.truncations,
                "mask": np.ones(len(e), dtype=np.bool_),
                "next_actions": np.concatenate([e.actions[1:], np.zeros_like(e.actions[:1])]),
                "log_probs": e.log_probs,
                "costs": costs_of(e.events),
                "episodes": np.full(len(e), position),
            }
            for name, rows in columns_of.items():
                columns.setdefault(name, []).append(rows)
        return {k: np.concatenate(rows) for k, rows in columns.items() if rows[0] is not None}

    @cached_property
    def rows(self) -> Rows:
        """Where each episode's transitions lie."""
        lengths = np.array([len(episode) for episode in self], dtype=np.int64)
        ends = lengths.cumsum()
        episode = np.repeat(np.arange(len(lengths)), lengths)
        valid, positions = np.arange(len(episode)), np.arange(len(lengths))
        return Rows(episode, ends - lengths, ends, valid=valid, positions=positions)

    def sampler(
        self,
        batch_size: int = 256,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int = 0,
    ) -> "MemorySampler":
        """Returns an endless stream of batches, as `Dataset.sampler` does."""
        window = None if horizon is None else partial(self.rows.window, horizon=horizon)
        if window is not None and burn_in is not None:
            window = partial(window, burn_in=burn_in)
        return MemorySampler(self.transitions, batch_size, seed, window)


class MemorySampler(BatchStream):
    """Draws transitions uniformly.

    Args:
        transitions: of all episodes, field by field.
        batch_size: transitions or windows in a batch.
        seed: of the stream.
        window: gives the rows of the steps of windows, and which are not padding; None draws single
            transitions.
    """

    def __init__(
        self,
        transitions: Mapping[str, NDArray[Any]],
        batch_size: int,
        seed: int,
        window: Callable[[Int], tuple[Int, Bool]] | None = None,
    ) -> None:
        super().__init__(batch_size, seed)
        self._transitions, self._window = transitions, window

    def _drawn(self, numbers: Seeds) -> Int:
        n_rows = len(self._transitions["mask"])
        return (uniform(derive(self.seed, numbers)) * n_rows).astype(np.int64)

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        """Returns the transitions at `index`, of any shape, or the windows there."""
        steps, mask = (index, None) if self._window is None else self._window(index)
        values: dict[str, NDArray[Any] | None] = {}
        for name, rows in self._transitions.items():
            is_read = wanted is None or name in wanted or name == "mask"
            values[name] = found = rows[steps] if is_read else None
            if found is not None and mask is not None:
                found[~mask] = 0  # of `mask` too, which is True elsewhere
        return Batch(**values)

    def identity(self) -> dict[str, int]:
        """Returns what another sampler needs to have in common to resume the stream."""
        return {"seed": self.seed, "batch_size": self.batch_size}
