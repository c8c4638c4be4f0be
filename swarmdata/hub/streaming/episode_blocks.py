"""EpisodeBlocks: consecutive episodes that are read, and observed again, together."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.reobservation import (
    OBSERVED_ARRAYS,
    RecordedEpisodes,
    actions_for,
    observe_episodes,
)
from swarmdata.hub.streaming.remote_arrays import RemoteArrays
from swarmdata.registry.components import make_task
from swarmdata.specs.origins import Origin, task_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS, EpisodeTable, Manifest
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.store.arrays.running_moments import RunningMoments
from swarmdata.types import Double, Int

BLOCK_STEPS = 10_000  # joint steps of a block, about those of a chunk

N_MEASURED_BLOCKS = 16
"""Blocks on which the observations of other sensors are measured to normalize them."""

N_FETCHERS = 4  # arrays of a block that are fetched at a time


@dataclass(frozen=True, eq=False)
class EpisodeBlocks:
    """Blocks of whole episodes of a remote dataset."""

    source: RemoteArrays  # the arrays
    table: EpisodeTable  # all stored episodes
    recipe: Origin  # what the dataset was made from
    spec: TaskSpec | None = None
    """The task with other models, through which it is observed again; None: as recorded."""
    _last: dict[int, dict[str, NDArray[Any]]] = field(default_factory=dict, repr=False)
    """The block that `rows` read last, each array fetched when it is asked for."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles what is fetched from, not what was."""
        return EpisodeBlocks, (self.source, self.table, self.recipe, self.spec)

    @property
    def manifest(self) -> Manifest:
        return self.source.manifest

    @cached_property
    def firsts(self) -> Int:
        """First episode of each block, and the number of episodes, [n + 1]."""
        ends = self.table.starts + self.table.lengths
        firsts = [0]
        while firsts[-1] < len(ends):
            limit = int(self.table.starts[firsts[-1]]) + BLOCK_STEPS
            last = int(np.searchsorted(ends, limit, side="right"))
            firsts.append(max(firsts[-1] + 1, last))
        return np.array(firsts)

    @cached_property
    def first_steps(self) -> Int:
        """First step of each block, and the number of steps, [n + 1]."""
        steps: Int = np.append(self.table.starts, self.manifest.n_steps)[self.firsts]
        return steps

    @cached_property
    def observation_moments(self) -> tuple[Double, Double]:
        """Mean and deviation of observations, [O], in `N_MEASURED_BLOCKS` of the train split."""
        train = self.table.split == SPLITS.index("train")
        live = np.unique(self.block_of(np.flatnonzero(train)))
        places = np.arange(min(N_MEASURED_BLOCKS, len(live))) * len(live)
        moments = RunningMoments()
        for block in live[places // min(N_MEASURED_BLOCKS, len(live))].tolist():
            rows = self.read(block, ("observations",))["observations"]
            episodes = slice(int(self.firsts[block]), int(self.firsts[block + 1]))
            chosen = np.repeat(train[episodes], self.table.lengths[episodes] + 1)
            moments.add(rows[chosen].reshape(-1, rows.shape[-1]))
        mean, std = moments.result()
        return np.array(mean), np.array(std)

    def block_of(self, episodes: Int | int) -> Any:
        return np.searchsorted(self.firsts, episodes, side="right") - 1

    def rows(self, number: int, name: str) -> NDArray[Any]:
        """Returns the rows of an array in an episode."""
        block = int(self.block_of(number))
        held = self._last.get(block, {})
        if name not in held:
            is_computed = self.spec is not None and name in OBSERVED_ARRAYS
            held = held | self.read(block, OBSERVED_ARRAYS if is_computed else (name,))
            self._last.clear()
            self._last[block] = held
        first, n_rows = int(self.table.starts[number]), int(self.table.lengths[number])
        first -= int(self.first_steps[block])
        if ALL_FIELDS[name].rows == "states":
            first, n_rows = first + number - int(self.firsts[block]), n_rows + 1
        return held[name][first : first + n_rows]

    def read(self, block: int, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Returns the rows of a block in some arrays over time."""
        if self.spec is None:
            return self._recorded(block, names)
        wanted = {*names} - {*OBSERVED_ARRAYS}
        is_observed = len(wanted) < len(names)
        needed = wanted | ({"states", "actions"} if is_observed else set())
        found = self._recorded(block, sorted(needed))
        task = task_of(self.recipe, "reobservation")
        if "actions" in found:
            found["actions"] = actions_for(self.spec, task, found["actions"])
        if is_observed:
            episodes = slice(int(self.firsts[block]), int(self.firsts[block + 1]))
            recorded = RecordedEpisodes(
                found["states"],
                found["actions"],
                starts=self.table.starts[episodes] - self.first_steps[block],
                lengths=self.table.lengths[episodes],
                seeds=self.table.seeds[episodes],
                layouts=self.table.layouts[episodes],
            )
            found |= observe_episodes(make_task(self.spec), recorded, progress=False)
        return {name: found[name] for name in names}

    def _recorded(self, block: int, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        first, last = (int(self.first_steps[block + k]) for k in (0, 1))
        episodes = [int(self.firsts[block + k]) for k in (0, 1)]

        def fetch(name: str) -> NDArray[Any]:
            shifts = episodes if ALL_FIELDS[name].rows == "states" else (0, 0)
            return self.source.rows(name, first + shifts[0], last + shifts[1])

        with ThreadPoolExecutor(N_FETCHERS) as pool:
            return dict(zip(names, pool.map(fetch, names), strict=True))
