"""The episode table as Parquet, one row per episode, for viewers, SQL and data frames."""

import io
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.runtime.extras import require_extra
from swarmdata.store import SPLITS
from swarmdata.types import END_REASONS

EPISODES_FILE = "episodes.parquet"  # the table of all episodes, beside the dataset's files

EPISODE_COLUMNS = {
    "episode": "number in stored order",
    "start": "first row in the arrays with a row per step; with a row per state, start + episode",
    "length": "joint steps",
    "seed": "of the episode",
    "split": "train, validation or test",
    "end_reason": "success, failure, horizon (cut), or ended (not told)",
    "policy": "label of the behavior policy",
    "policy_episode": "number in that policy's stream",
    "team_return": "undiscounted sum of the mean reward over agents",
    "success": "whether the task was solved",
    "robot_collisions": "contacts between robots that began; a pair counts once",
    "obstacle_collisions": "contacts with obstacles or walls that began",
}
"""What each column says."""


def arrow() -> Any:
    """Returns the library pyarrow, or raises MissingExtraError."""
    require_extra("pyarrow", "parquet", "Parquet")
    import pyarrow.parquet  # noqa: PLC0415  (an extra)

    return pyarrow


def episode_table(dataset: Dataset) -> Any:
    """The episodes of a view as a `pyarrow.Table` with `EPISODE_COLUMNS`."""
    table = dataset.episodes
    labels = np.array([source.label for source in dataset.recipe.policies], dtype=object)
    columns = {
        "episode": dataset.selection,
        "start": table.starts,
        "length": table.lengths,
        "seed": table.seeds,
        "split": np.array(SPLITS, dtype=object)[table.split],
        "end_reason": np.array(END_REASONS, dtype=object)[table.end_reason],
        "policy": labels[table.policy],
        "policy_episode": table.policy_episode,
        "team_return": table.team_return,
        "success": table.success,
        "robot_collisions": table.robot_collisions,
        "obstacle_collisions": table.obstacle_collisions,
    }
    return arrow().table(columns)


def parquet_bytes(table: Any) -> bytes:
    """A `pyarrow.Table` as the bytes of a Parquet file."""
    buffer = io.BytesIO()
    arrow().parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()
