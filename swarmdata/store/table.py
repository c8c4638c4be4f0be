"""EpisodeTable, one column per fact about an episode, and how a row is measured from an Episode."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.types import (
    END_REASONS,
    EVENTS,
    Bool,
    Counts,
    Double,
    Episode,
    Float,
    Int,
    Seeds,
)

SPLITS = ("train", "validation", "test")  # splits by code


@dataclass(frozen=True, slots=True)
class EpisodeRow:
    """What is known of one episode without reading its steps."""

    index: int  # in the table, and so in the view: `dataset[row.index]`
    length: int  # joint steps
    seed: int
    split: str  # one of SPLITS
    end_reason: str  # one of END_REASONS
    policy: int  # index into the recipe's policies
    policy_episode: int  # index in that policy's stream of episodes
    team_return: float  # sum over time of the mean reward over agents
    success: bool
    robot_collisions: int
    obstacle_collisions: int


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeTable:
    """The episodes of a dataset or view, in stored order; a sequence of `EpisodeRow`."""

    starts: Int  # [n] first row in the arrays with T rows; the row with T+1 is start + index
    lengths: Int  # [n] joint steps, T
    seeds: Seeds  # [n]
    layouts: Float  # [n, M, 8] obstacles, columns `geometry.OBSTACLE`
    split: Counts  # [n] index into SPLITS
    end_reason: Counts  # [n] index into END_REASONS
    policy: Counts  # [n] index into the recipe's policies
    policy_episode: Int  # [n] index in that policy's stream of episodes
    team_return: Double  # [n] sum over time of the mean reward over agents
    success: Bool  # [n]
    robot_collisions: Int  # [n] contacts between robots that began; a pair counts once
    obstacle_collisions: Int  # [n] contacts with obstacles or walls that began

    def __len__(self) -> int:
        return len(self.starts)

    def __repr__(self) -> str:
        names = ", ".join(field.name for field in fields(self))
        return f"EpisodeTable({len(self)} episodes: {names})"

    @overload
    def __getitem__(self, index: int | np.integer[Any]) -> EpisodeRow: ...
    @overload
    def __getitem__(self, index: "slice | Sequence[int] | NDArray[Any]") -> "EpisodeTable": ...
    def __getitem__(self, index: Any) -> "EpisodeRow | EpisodeTable":
        """Returns one episode's row; of a slice, indices or a mask [n], the table of these.

        Raises:
            IndexError: there is no such episode.
        """
        if not isinstance(index, int | np.integer):
            return self.take(np.arange(len(self))[index])
        if not -len(self) <= index < len(self):
            raise IndexError(f"episode {index} of a table of {len(self)} episodes")
        (row,) = self.take(np.array([index]))
        return replace(row, index=int(index) % len(self))

    def __iter__(self) -> Iterator[EpisodeRow]:
        columns = (column.tolist() for column in self._row_columns().values())
        return map(EpisodeRow, *columns)

    def _row_columns(self) -> dict[str, NDArray[Any]]:
        """The fields of `EpisodeRow`, [n] each."""
        named = {
            "index": np.arange(len(self)),
            "length": self.lengths,
            "seed": self.seeds,
            "split": np.array(SPLITS)[self.split],
            "end_reason": np.array(END_REASONS)[self.end_reason],
        }
        columns = {**self.columns(), **named}
        return {field.name: columns[field.name] for field in fields(EpisodeRow)}

    def to_pandas(self) -> Any:
        """Returns a `pandas.DataFrame` with a row for each episode: the fields of `EpisodeRow`.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        try:
            import pandas  # noqa: PLC0415  (an extra)
        except ImportError as error:
            raise MissingExtraError("pandas", "pandas", "EpisodeTable.to_pandas") from error
        return pandas.DataFrame(self._row_columns()).set_index("index")

    def take(self, indices: Int) -> "EpisodeTable":
        """Returns the rows `indices`, in that order."""
        return EpisodeTable(**{name: column[indices] for name, column in self.columns().items()})

    def columns(self, prefix: str = "") -> dict[str, NDArray[Any]]:
        """The columns by name, which begins with `prefix`."""
        return {f"{prefix}{field.name}": getattr(self, field.name) for field in fields(self)}


PART_COLUMNS = np.dtype(
    [
        ("length", "<i8"),
        ("seed", "<u8"),
        ("policy", "<u1"),
        ("end_reason", "<u1"),
        ("team_return", "<f8"),
        ("robot_collisions", "<i8"),
        ("obstacle_collisions", "<i8"),
    ]
)
"""Row of a part's episode table."""


PartTable = NDArray[np.void]  # the episodes of one part, [n], with `PART_COLUMNS`


def n_steps_of(*tables: PartTable) -> int:
    """Joint steps of all episodes of some parts."""
    return sum(int(table["length"].sum()) for table in tables)


def measure(episode: Episode) -> tuple[int, int, int, int, float, int, int]:
    """Returns the `PART_COLUMNS` row of an episode.

    Raises:
        SchemaError: an episode without steps, or robot contact onsets that do not come in pairs.
    """
    if len(episode) == 0:
        raise SchemaError(f"episode with seed {episode.seed} has no steps, expected at least 1")
    onsets = np.zeros(len(EVENTS), dtype=np.int64)  # where no events were recorded
    if episode.events.shape[2]:
        onsets = episode.events.sum(axis=(0, 1), dtype=np.int64)
    robot = int(onsets[EVENTS.index("robot_onsets")])
    if robot % 2:
        raise SchemaError(
            f"events of the episode with seed {episode.seed} have {robot} robot onsets, expected "
            "an even number: each contact begins for both robots in the same step"
        )
    obstacle = int(onsets[EVENTS.index("obstacle_onsets")])
    head = (len(episode), episode.seed, episode.policy, episode.end_reason)
    return (*head, episode.team_return, robot // 2, obstacle)


def team_returns(table: EpisodeTable, rewards: Float) -> Double:
    """Sums over each episode of the mean reward over agents, [n], read-only, of rewards [T, N]."""
    episodes = zip(table.starts.tolist(), (table.starts + table.lengths).tolist(), strict=True)
    returns = np.array(
        [rewards[first:end].mean(axis=1, dtype=np.float64).sum() for first, end in episodes]
    )
    returns.setflags(write=False)
    return returns


def clean_successes(table: EpisodeTable) -> Bool:
    """Solved without touching anything, [n]: a contact has its beginning among the collisions."""
    return table.success & (table.robot_collisions + table.obstacle_collisions == 0)
