"""EpisodeTable, one column per fact about an episode, and how a row is measured from an Episode."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.types import EVENTS, Bool, Counts, Double, Episode, Float, Int, Seeds

SPLITS = ("train", "validation", "test")
"""Splits by code."""


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeTable:
    """The episodes of a dataset or view, in stored order."""

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
        """Number of episodes."""
        return len(self.starts)

    def __repr__(self) -> str:
        """Shows the columns, not the values."""
        names = ", ".join(field.name for field in fields(self))
        return f"EpisodeTable({len(self)} episodes: {names})"

    def take(self, indices: Int) -> "EpisodeTable":
        """Returns the rows `indices`, in that order."""
        return EpisodeTable(**{name: column[indices] for name, column in self.columns().items()})

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


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


@dataclass(frozen=True, slots=True, eq=False)
class PartTable:
    """The episodes of one part, as `PART_COLUMNS`."""

    rows: NDArray[np.void]  # [n], columns PART_COLUMNS

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.rows)

    @property
    def lengths(self) -> Int:
        """Joint steps of each episode, [n]."""
        return self.rows["length"]

    @property
    def seeds(self) -> Seeds:
        """Seed of each episode, [n]."""
        return self.rows["seed"]

    @property
    def team_returns(self) -> Double:
        """Team return of each episode, [n]."""
        return self.rows["team_return"]

    @property
    def n_steps(self) -> int:
        """Joint steps of all episodes."""
        return int(self.lengths.sum())


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


def table_columns(table: EpisodeTable) -> Mapping[str, NDArray[Any]]:
    """The columns by array name, `episodes/...`."""
    return {f"episodes/{name}": column for name, column in table.columns().items()}


def clean_successes(table: EpisodeTable) -> Bool:
    """Solved without touching anything, [n]: a contact has its beginning among the collisions."""
    return table.success & (table.robot_collisions + table.obstacle_collisions == 0)
