"""Sampler, an endless seeded stream of transitions or masked windows, gathered at memory speed."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from types import NoneType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError, check_type
from swarmdata.numerics.event_costs import costs_of
from swarmdata.numerics.random import derive, uniform
from swarmdata.runtime.mapped_pages import gather_rows, take_rows
from swarmdata.specs.action_scaling import ActionScale
from swarmdata.store import EpisodeTable
from swarmdata.types import Batch, Bool, Double, Float, Int, Seeds, Wanted

COPIED_FIELDS = (
    "observations", "states", "actions", "log_probs", "rewards", "terminations", "truncations",
)  # fmt: skip
"""Arrays whose rows are in `copy_transitions` as they are."""

AGENT_FIELDS = ("alive", "agent_terminations", "agent_truncations")
"""Likewise, where agents can leave."""

N_DRAWN_AHEAD = 1 << 14
"""Random numbers made at once; NumPy calls on single batches would cost as much as the gather."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Where the transitions of some episodes lie in the stored arrays.

    An index is a row of the arrays with T rows; its observation is `episode` rows further on.
    """

    episode: Int  # [sum T] stored number of the episode that each row of the dataset belongs to
    starts: Int  # [n] first row of each stored episode
    ends: Int  # [n] row after the last of each stored episode
    valid: Int  # [n valid] rows of the selected episodes
    positions: Int  # [n] of the stored episodes among the selected ones; -1: not selected

    @classmethod
    def locate(cls, table: EpisodeTable, selection: Int) -> "Rows":
        """Finds the rows of the stored episodes `selection` of the whole `table`."""
        ends = table.starts + table.lengths
        episode = np.repeat(np.arange(len(table)), table.lengths)
        lengths = table.lengths[selection]
        shifts = table.starts[selection] - (np.cumsum(lengths) - lengths)
        valid = np.arange(int(lengths.sum())) + np.repeat(shifts, lengths)
        positions = np.full(len(table), -1)
        positions[selection] = np.arange(len(selection))
        return cls(
            episode=episode, starts=table.starts, ends=ends, valid=valid, positions=positions
        )

    def window(self, index: Int, horizon: int, burn_in: int | None = None) -> tuple[Int, Bool]:
        """Returns the rows of the steps of windows, and which of them are not padding, [..., L].

        Rows of padding are those of the episode's nearest step.

        Args:
            index: rows that choose the windows, [...].
            horizon: steps of a window.
            burn_in: None: a window starts at its row. Else it is the segment that holds the row,
                of those of `horizon` steps into which the episode is cut from its start, and the
                `burn_in` steps before the segment; L is then `burn_in + horizon`.
        """
        episode = self.episode.take(index)[..., None]
        start, end = self.starts.take(episode), self.ends.take(episode)
        first, before = index[..., None], 0
        if burn_in is not None:
            first, before = start + (first - start) // horizon * horizon, burn_in
        steps = first + np.arange(-before, horizon)
        return np.clip(steps, start, end - 1), (steps >= start) & (steps < end)


def copy_transitions(
    arrays: Mapping[str, NDArray[Any]], table: EpisodeTable, selection: Int
) -> dict[str, NDArray[Any]]:
    """Copies all transitions of the selected episodes, [n], one episode after the other."""
    rows = Rows.locate(table, selection)
    steps, states = rows.valid, rows.valid + rows.episode.take(rows.valid)
    of_states = ("observations", "states")
    copied = {
        name: take_rows(arrays[name], states if name in of_states else steps)
        for name in COPIED_FIELDS
    }
    later = {f"next_{name}": take_rows(arrays[name], states + 1) for name in of_states}
    recorded = [name for name in AGENT_FIELDS if name in arrays]
    copied |= {n: take_rows(arrays[n], states if n == "alive" else steps) for n in recorded}
    costs = costs_of(take_rows(arrays["events"], steps))
    return copied | later | ({} if costs is None else {"costs": costs})


def _gather(
    arrays: Mapping[str, NDArray[Any]], rows: Rows, index: Int, mask: Bool, wanted: Wanted
) -> Batch:
    """Gathers the wanted fields of the rows `index`, of any shape, of the arrays with T rows."""
    episode = rows.episode.take(index)
    states = index + episode

    def rows_of(name: str, at: Int) -> NDArray[Any]:
        return gather_rows(arrays[name], at)

    def if_recorded(name: str, at: Int) -> NDArray[Any] | None:
        has_some = name in arrays and arrays[name].shape[1]  # [T, 0] where none were recorded
        return rows_of(name, at) if has_some else None

    reads: dict[str, Callable[[], NDArray[Any] | None]] = {
        "observations": lambda: rows_of("observations", states),
        "actions": lambda: rows_of("actions", index),
        "rewards": lambda: rows_of("rewards", index),
        "next_observations": lambda: rows_of("observations", states + 1),
        "states": lambda: rows_of("states", states),
        "next_states": lambda: rows_of("states", states + 1),
        "terminations": lambda: rows_of("terminations", index),
        "truncations": lambda: rows_of("truncations", index),
        "next_actions": lambda: _next_actions(arrays["actions"], rows, index),
        "log_probs": lambda: if_recorded("log_probs", index),
        "episodes": lambda: rows.positions.take(episode),
        "costs": lambda: costs_of(rows_of("events", index)),
        "alive": lambda: if_recorded("alive", states),
        "agent_terminations": lambda: if_recorded("agent_terminations", index),
        "next_alive": lambda: if_recorded("alive", states + 1),
    }
    return Batch(
        mask=mask,
        **{
            name: read() if wanted is None or name in wanted else None
            for name, read in reads.items()
        },
    )


def _blank_padding(batch: Batch) -> None:
    """Makes every field zero outside of the episodes, where the mask is False."""
    padding = np.nonzero(~batch.mask)
    for field in fields(batch):
        values = getattr(batch, field.name)
        if field.name != "mask" and values is not None:
            values[padding] = 0


def _next_actions(actions: NDArray[Any], rows: Rows, index: Int) -> NDArray[Any]:
    last = rows.ends.take(rows.episode.take(index)) - 1
    found = gather_rows(actions, np.minimum(index + 1, last))
    found[index == last] = 0  # nobody acts after the end
    return found


class SampledView(Protocol):
    """What a pickled sampler, or a torch `DataLoader`, needs of the dataset that is sampled."""

    @property
    def sampler(self) -> Callable[..., "BatchStream"]: ...


class BatchStream(ABC):
    """An endless stream of batches of B transitions or windows; the seed is below 2**64."""

    def __init__(self, batch_size: int, seed: int) -> None:
        self.batch_size, self.seed = batch_size, seed
        self._n_drawn = self._first_ahead = 0
        self._ahead = np.empty((0, batch_size), dtype=np.int64)

    @abstractmethod
    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        """Returns the transitions or windows that start at `index`, rows of any shape.

        Raises:
            IndexError: an index outside the dataset.
        """

    @abstractmethod
    def identity(self) -> dict[str, int]:
        """Returns what another sampler needs to have in common to resume the stream."""

    @abstractmethod
    def _drawn(self, numbers: Seeds) -> Int:
        """The rows of consecutive draws; draw number k of a seed is always the same."""

    def _n_ahead(self) -> int:
        """Batches that are drawn at once."""
        return max(1, N_DRAWN_AHEAD // self.batch_size)

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Batch:
        return self.gather(self.draw())

    def draw(self) -> Int:
        """Returns the rows of the next batch, int64 [B], without reading any data."""
        offset = self._n_drawn - self._first_ahead
        if not 0 <= offset < len(self._ahead):
            self._first_ahead, offset = self._n_drawn, 0
            first = self._n_drawn * self.batch_size
            numbers = np.arange(first, first + self._n_ahead() * self.batch_size, dtype=np.uint64)
            self._ahead = self._drawn(numbers).reshape(-1, self.batch_size)
        self._n_drawn += 1
        index: Int = self._ahead[offset].copy()
        return index

    def state_dict(self) -> dict[str, int]:
        """Everything needed to resume the stream: plain integers."""
        return {**self.identity(), "n_drawn": self._n_drawn}

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        """Continues where the sampler that returned `state` was.

        Raises:
            SchemaError: the state is of a sampler with other settings or other data.
        """
        saved = {name: value for name, value in state.items() if name != "n_drawn"}
        if saved != self.identity() or state.get("n_drawn", -1) < 0:
            raise SchemaError(
                f"sampler state is {dict(state)}, expected n_drawn and {self.identity()}: resume "
                "with the settings and the data that the state was saved with"
            )
        self._n_drawn, self._ahead = state["n_drawn"], self._ahead[:0]


class RowSampler(BatchStream):
    """Draws from the episodes of one dataset; a mixture draws from several of them."""

    n_rows: int  # of the dataset, which an index counts
    n_episodes: int  # that are drawn from
    agents_leave: bool  # whether batches say which agents act

    @abstractmethod
    def dtype(self, name: str) -> np.dtype[Any]:
        """The dtype of an array."""

    @abstractmethod
    def width(self, name: str) -> int:
        """The size of an array's last axis; 0: it was not recorded."""

    @abstractmethod
    def pick(self, places: Double, n_before: int) -> Int:
        """Returns the rows at places in [0, 1) among the transitions that can be drawn, any shape.

        `n_before` rows were drawn before, by which the window of a stream has moved.
        """

    @abstractmethod
    def settings(self) -> dict[str, int]:
        """Returns what was chosen about the stream, without the data."""

    def _drawn(self, numbers: Seeds) -> Int:
        return self.pick(uniform(derive(self.seed, 0, numbers)), int(numbers[0]))


class Sampler(RowSampler):
    """Draws batches uniformly, with replacement, over the transitions of some episodes.

    With a `horizon`, every transition is equally likely to start a window. With a `burn_in` as
    well, windows are segments (`Rows.window`), chosen in proportion to their steps.

    Args:
        arrays: the stored arrays.
        table: all stored episodes.
        selection: stored episodes to draw from, [n].
        batch_size: joint transitions, or windows, of a batch, B.
        horizon: steps of a window, L.
        burn_in: steps before a segment.
        seed: of the stream of batches, 0 to 2**64 - 1.
        scale: of the actions; None gives them as they are stored.
        rows: where the episodes lie; None: one after the other, as in a stored dataset.
        view: the dataset whose `sampler` this is; a pickle has it instead of the arrays.

    Raises:
        SchemaError: nothing to draw from, or a size below 1.
    """

    def __init__(
        self,
        arrays: Mapping[str, NDArray[Any]],
        table: EpisodeTable,
        selection: Int,
        *,
        batch_size: int = 256,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int = 0,
        scale: ActionScale | None = None,
        rows: Rows | None = None,
        view: "SampledView | None" = None,
    ) -> None:
        if len(selection) == 0:
            raise SchemaError("there are no episodes to sample from; widen the filter")
        whole = (int, np.integer)
        for name, given in {"batch_size": batch_size, "seed": seed}.items():
            check_type(f"sampler {name}", given, whole, "a whole number")
        for name, length in {"horizon": horizon, "burn_in": burn_in}.items():
            check_type(f"sampler {name}", length, (*whole, NoneType), "a whole number or None")
        if batch_size < 1 or (horizon is not None and horizon < 1):
            raise SchemaError(
                f"sampler got batch_size={batch_size} and horizon={horizon}, expected at least 1"
            )
        if burn_in is not None and (horizon is None or burn_in < 0):
            raise SchemaError(
                f"sampler got burn_in={burn_in} and horizon={horizon}, expected at least 0 steps "
                "before the segments of a horizon"
            )
        if not 0 <= seed < 1 << 64:
            raise SchemaError(f"sampler seed is {seed}, expected 0 to 2**64 - 1")
        super().__init__(batch_size, seed)
        self.horizon, self.burn_in = horizon, burn_in
        self.rows = Rows.locate(table, selection) if rows is None else rows
        self.n_rows, self.n_episodes = len(self.rows.episode), len(selection)
        self.agents_leave = "alive" in arrays
        self._arrays, self._scale, self._view = arrays, scale, view

    def __getstate__(self) -> dict[str, Any]:
        """Returns what is pickled: the view and the place in its stream; without a view, all."""
        if self._view is None:
            return self.__dict__
        names = ("batch_size", "horizon", "burn_in", "seed", "_view", "_n_drawn")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        if (view := state["_view"]) is not None:
            names = ("batch_size", "horizon", "burn_in", "seed")
            fresh = view.sampler(**{name: state[name] for name in names})
            state = {**fresh.__dict__, **state}
        self.__dict__.update(state)

    def __repr__(self) -> str:
        return (
            f"Sampler({len(self.rows.valid)} transitions, batch_size={self.batch_size}, "
            f"horizon={self.horizon}, seed={self.seed}, n_drawn={self._n_drawn})"
        )

    def dtype(self, name: str) -> np.dtype[Any]:
        return self._arrays[name].dtype

    def width(self, name: str) -> int:
        return self._arrays[name].shape[-1]

    def pick(self, places: Double, n_before: int = 0) -> Int:
        return take_at(self.rows.valid, places)

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        """Returns the transitions or windows that start at `index`.

        Args:
            index: rows as `draw` returns them, any shape; draws of K samplers stacked to [K, B]
                give fields [K, B, ...] in one call.
            wanted: fields to read, such as `{"observations", "actions"}`; the others are None.

        Raises:
            IndexError: an index outside the dataset.
            SchemaError: actions that are to be scaled lie outside their bounds.
        """
        if index.size and index.min() < 0:  # NumPy would count it from the end
            raise IndexError(f"index {index.min()} is negative, expected rows of the dataset")
        if self.horizon is None:
            steps, mask = index, np.ones(index.shape, dtype=np.bool_)
        else:
            steps, mask = self.rows.window(index, self.horizon, self.burn_in)
        batch = _gather(self._arrays, self.rows, steps, mask, wanted)
        if not mask.all():
            _blank_padding(batch)
        if self._scale is None:
            return batch
        last = self.rows.ends.take(self.rows.episode.take(steps)) - 1
        next_steps, has_next = np.minimum(steps + 1, last), mask & (steps < last)
        return replace(
            batch,
            actions=self._to_unit(batch.actions, steps, mask),
            next_actions=self._to_unit(batch.next_actions, next_steps, has_next),
        )

    def _to_unit(self, actions: Float | None, steps: Int, mask: Bool) -> Float | None:
        """Scales the actions of some steps, [..., N, A]; those of absent agents become 0."""
        assert self._scale is not None  # callers check it
        if actions is None:
            return None
        acting = mask[..., None]
        if "alive" in self._arrays:
            states = steps + self.rows.episode.take(steps)
            acting = acting & gather_rows(self._arrays["alive"], states)
        return self._scale.to_unit(np.where(acting[..., None], actions, self._scale.middle))

    def identity(self) -> dict[str, int]:
        return self.settings() | {"n_transitions": len(self.rows.valid)}

    def settings(self) -> dict[str, int]:
        return ({} if self.burn_in is None else {"burn_in": self.burn_in}) | {
            "seed": self.seed,
            "batch_size": self.batch_size,
            "horizon": self.horizon or 0,
        }


def take_at(rows: Int, places: Double) -> Int:
    """Returns the rows at places in [0, 1), any shape."""
    # the product rounds up to the number of rows in rare cases
    return rows.take(np.minimum(places * len(rows), len(rows) - 1).astype(np.int64))
