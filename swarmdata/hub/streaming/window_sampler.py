"""WindowSampler: shuffled batches of a remote dataset, of which a window of blocks is in memory."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.reobservation import OBSERVED_ARRAYS
from swarmdata.datasets.sampling import Rows, RowSampler, SampledView, Sampler, take_at
from swarmdata.hub.streaming.episode_blocks import EpisodeBlocks
from swarmdata.numerics.random import derive
from swarmdata.specs.action_scaling import ActionScale
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.types import Batch, Double, Int, Wanted

BATCH_ARRAYS = (
    "observations", "states", "actions", "rewards", "terminations", "truncations", "log_probs",
    "events", "alive", "agent_terminations",
)  # fmt: skip
"""Arrays that batches are made of; the last two where agents can leave."""


class BlockMemory:
    """Blocks in memory, each in a slot of the same arrays, so that one gather reads all of them.

    All slots have the size of the largest block: a state is still its step plus its episode on.
    """

    def __init__(self, blocks: EpisodeBlocks, selection: Int, n_slots: int) -> None:
        self._blocks = blocks
        self._n_episodes = int(np.diff(blocks.firsts).max())
        self._n_steps = int(np.diff(blocks.first_steps).max())
        self._names = tuple(n for n in BATCH_ARRAYS if n in blocks.manifest.arrays)
        self._slots: OrderedDict[int, int] = OrderedDict()  # by block, least recently used first
        self._free = list(range(n_slots))
        self._coming: dict[int, Future[dict[str, NDArray[Any]]]] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="swarmdata-stream")
        self._selected = np.full(len(blocks.table), -1)
        self._selected[selection] = np.arange(len(selection))
        self.shifts = np.zeros(len(blocks.firsts) - 1, dtype=np.int64)  # of rows, by block
        self.arrays: dict[str, NDArray[Any]] = {}
        n = n_slots * self._n_episodes
        self.rows = Rows(
            episode=np.zeros(n_slots * self._n_steps, dtype=np.int64),
            starts=np.zeros(n, dtype=np.int64),
            ends=np.zeros(n, dtype=np.int64),
            valid=np.zeros(0, dtype=np.int64),
            positions=np.full(n, -1),
        )

    def hold(self, wanted: Sequence[int]) -> None:
        """Puts blocks into memory, in the place of those that were not used for longest."""
        for block in wanted:
            if block in self._slots:
                self._slots.move_to_end(block)
        for block in wanted:
            if block in self._slots:
                continue
            coming = self._coming.pop(block, None)
            arrays = self._read(block) if coming is None else coming.result()
            slot = self._free.pop() if self._free else self._slots.popitem(last=False)[1]
            self._slots[block] = slot
            self._fill(slot, block, arrays)

    def expect(self, block: int) -> None:
        """Fetches a block in the background; `hold` raises what goes wrong."""
        if block not in self._slots and block not in self._coming:
            self._coming[block] = self._pool.submit(self._read, block)

    def _read(self, block: int) -> dict[str, NDArray[Any]]:
        return self._blocks.read(block, self._names)

    def _fill(self, slot: int, block: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        first_step, first_episode = slot * self._n_steps, slot * self._n_episodes
        for name, values in arrays.items():
            is_states = ALL_FIELDS[name].rows == "states"
            if name not in self.arrays:
                n_slots = len(self.rows.episode) // self._n_steps
                n_rows = n_slots * (self._n_steps + is_states * self._n_episodes)
                self.arrays[name] = np.zeros((n_rows, *values.shape[1:]), dtype=values.dtype)
            first = first_step + is_states * first_episode
            self.arrays[name][first : first + len(values)] = values
        blocks, rows = self._blocks, self.rows
        episodes = slice(int(blocks.firsts[block]), int(blocks.firsts[block + 1]))
        lengths = blocks.table.lengths[episodes]
        self.shifts[block] = first_step - blocks.first_steps[block]
        here = slice(first_episode, first_episode + len(lengths))
        rows.starts[here] = blocks.table.starts[episodes] + self.shifts[block]
        rows.ends[here] = rows.starts[here] + lengths
        rows.positions[here] = self._selected[episodes]
        numbers = np.repeat(np.arange(here.start, here.stop), lengths)
        rows.episode[first_step : first_step + len(numbers)] = numbers


class WindowSampler(RowSampler):
    """Draws batches uniformly over a window of blocks, which moves through shuffled blocks.

    The window holds `window` consecutive blocks of an endless sequence in which every pass has its
    own order of all blocks. After as many transitions as a block has on average, it moves on by
    one, so that a transition is drawn once a pass on average. A window of all blocks never moves
    and gives the batches of `Dataset.sampler`, bit for bit; reordered views draw in
    the stored order.

    A batch is a pure function of the seeds and its number. The order of the blocks is that of the
    dataset (`order_seed`), not of the sampler's seed: what one sampler has drawn another may
    gather. A pickle has `view`, the dataset, instead of blocks in memory.
    """

    def __init__(
        self,
        blocks: EpisodeBlocks,
        selection: Int,
        *,
        window: int,
        order_seed: int,
        batch_size: int,
        horizon: int | None,
        burn_in: int | None,
        seed: int,
        scale: ActionScale | None,
        view: SampledView,
    ) -> None:
        chosen = np.searchsorted(blocks.firsts, selection, side="right") - 1
        self._live = np.unique(chosen)  # blocks with an episode to draw from
        self._window, self._order_seed = min(window, len(self._live)), order_seed
        self._blocks, self._selection, self._chosen = blocks, selection, chosen
        self._view = view
        self._memory = BlockMemory(blocks, selection, self._window + 2)
        self._inner = Sampler(  # checks the sizes, and gathers
            self._memory.arrays,
            blocks.table,
            selection,
            batch_size=batch_size,
            horizon=horizon,
            burn_in=burn_in,
            seed=seed,
            scale=scale,
            rows=self._memory.rows,
        )
        self.agents_leave = "alive" in blocks.manifest.arrays
        self._n_steps = int(blocks.table.lengths[selection].sum())
        steps = self._n_steps / len(self._live) / (batch_size * (horizon or 1))
        self._turn_batches = max(1, round(steps))
        super().__init__(batch_size, seed)
        self._turn = 0
        self._valid_rows = lru_cache(maxsize=2)(self._find_valid_rows)
        self.horizon, self.burn_in = horizon, burn_in
        self.n_rows, self.n_episodes = blocks.manifest.n_steps, len(selection)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the view and the place in its stream."""
        names = ("batch_size", "horizon", "burn_in", "seed")
        return _resumed, (self._view, {name: getattr(self, name) for name in names}, self._n_drawn)

    def __repr__(self) -> str:
        return (
            f"WindowSampler({self._n_steps} transitions, {self._window} of {len(self._live)} "
            f"blocks in memory, batch_size={self.batch_size}, horizon={self.horizon}, "
            f"seed={self.seed}, n_drawn={self._n_drawn})"
        )

    def dtype(self, name: str) -> np.dtype[Any]:
        is_recorded = self._blocks.spec is None or name not in OBSERVED_ARRAYS
        return np.dtype(self._blocks.source.dtype(name) if is_recorded else np.float32)

    def width(self, name: str) -> int:
        return self._blocks.manifest.arrays[name].shape[-1]

    def _n_ahead(self) -> int:
        """Batches that are drawn from one place of the window."""
        left = self._turn_batches - self._n_drawn % self._turn_batches
        return min(left, super()._n_ahead())

    def pick(self, places: Double, n_before: int) -> Int:
        """A window of all blocks never moves."""
        if self._window < len(self._live):
            self._turn = n_before // (self._turn_batches * self.batch_size)
        return take_at(self._valid_rows(self._turn), places)

    def _block_at(self, position: int) -> int:
        """The block at a place of the endless sequence."""
        turn, place = divmod(position, len(self._live))
        keys = derive(self._order_seed, 1, np.uint64(turn), self._live.astype(np.uint64))
        return int(self._live[np.argsort(keys, kind="stable")[place]])

    def _find_valid_rows(self, turn: int) -> Int:
        """Stored rows of the selected episodes in the window, increasing, [n]."""
        inside = {self._block_at(turn + k) for k in range(self._window)}
        episodes = self._selection[np.isin(self._chosen, list(inside))]
        episodes = np.sort(episodes)
        lengths = self._blocks.table.lengths[episodes]
        shifts = self._blocks.table.starts[episodes] - (np.cumsum(lengths) - lengths)
        rows: Int = np.arange(int(lengths.sum())) + np.repeat(shifts, lengths)
        return rows

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        """Fetches blocks that are not in memory, and the next one in the background."""
        if index.size and not 0 <= index.min() <= index.max() < self.n_rows:
            raise IndexError(
                f"rows {index.min()} to {index.max()}, expected 0 to {self.n_rows - 1}"
            )
        block = np.searchsorted(self._blocks.first_steps, index, side="right") - 1
        held = np.unique(block).tolist()
        capacity = self._window + 2
        if len(held) > capacity:
            raise IndexError(
                f"the rows are of {len(held)} blocks, expected at most the {capacity} of a window"
            )
        self._memory.hold(held)
        batch = self._inner.gather(index + self._memory.shifts[block], wanted)
        if self._window < len(self._live):
            self._memory.expect(self._block_at(self._turn + self._window))
        return batch

    def settings(self) -> dict[str, int]:
        return self._inner.settings()

    def identity(self) -> dict[str, int]:
        own = {"window": self._window, "order_seed": self._order_seed}
        return self.settings() | own | {"n_transitions": self._n_steps}


def _resumed(view: SampledView, options: Mapping[str, Any], n_drawn: int) -> WindowSampler:
    sampler = view.sampler(**options)
    assert isinstance(sampler, WindowSampler)  # as it was there
    sampler.load_state_dict({**sampler.identity(), "n_drawn": n_drawn})
    return sampler
