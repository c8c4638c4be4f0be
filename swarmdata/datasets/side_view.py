"""One side of a dataset of several: the rows, returns and successes of its robots."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from swarmdata.datasets.normalization import Moments
from swarmdata.rollouts.side_policy import AGENT_ARRAYS, PAIR_ARRAYS, end_reason_for, rows_of_side
from swarmdata.specs.origins import SideSpec
from swarmdata.store import StoredDataset
from swarmdata.store.arrays.running_moments import Moments as RunningMoments
from swarmdata.types import END_REASONS

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class SideView:
    """The rows of one side."""

    whole: "Dataset"  # with the rows of all sides
    stored: StoredDataset  # the same files with the rows of this side
    spec: SideSpec

    @property
    def summary(self) -> str:
        """A few words."""
        return f"the {self.spec.side} alone"

    @property
    def note(self) -> str:
        """One paragraph about the side, Markdown."""
        return (
            f"> **This is one side**, the {self.spec.side}, with their observations, actions, "
            "rewards, returns and successes; states are those of all robots. The card below "
            "describes the whole dataset.\n"
        )

    @cached_property
    def moments(self) -> Moments:
        """Moments of the side's observations and rewards over the train split."""
        table, arrays = self.stored.table, self.stored.arrays
        observed, rewarded = RunningMoments(), RunningMoments()
        for number in np.flatnonzero(table.split == 0).tolist():
            rows = self.stored.rows(number, "observations")
            observed.add(np.ascontiguousarray(rows).reshape(-1, rows.shape[-1]))
            first = int(table.starts[number])
            rewards = arrays["rewards"][first : first + int(table.lengths[number])]
            rewarded.add(np.ascontiguousarray(rewards).reshape(-1, 1))
        mean, std = observed.result()
        (reward_mean,), (reward_std,) = rewarded.result()
        return Moments(np.array(mean), np.array(std), reward_mean, reward_std)


def side_view(whole: "Dataset", name: str) -> SideView:
    """Returns the rows of one side; only rewards are read.

    Args:
        whole: a dataset of all sides.
        name: of the side.

    Raises:
        UnknownNameError: the task has no such side.
        SpecError: the task has one side only, or the dataset is of another environment.
    """
    task, stored = whole.task, whole.stored
    side = task.side(name)
    arrays = {
        each: rows_of_side(each, stored.arrays[each], side)
        for each in (*AGENT_ARRAYS, *PAIR_ARRAYS)
        if each in stored.arrays
    }
    table, rewards = stored.table, arrays["rewards"]
    episodes = zip(table.starts.tolist(), (table.starts + table.lengths).tolist(), strict=True)
    returns = np.array(
        [rewards[first:end].mean(axis=1, dtype=np.float64).sum() for first, end in episodes]
    )
    ends = np.array(
        [end_reason_for(side, code) for code in table.end_reason.tolist()], dtype=np.uint8
    )
    columns = {
        "team_return": returns,
        "end_reason": ends,
        "success": ends == END_REASONS.index("success"),
    }
    for each, column in columns.items():
        column.setflags(write=False)
        if f"episodes/{each}" in stored.arrays:
            arrays[f"episodes/{each}"] = column
    seen = replace(stored, arrays={**stored.arrays, **arrays}, table=replace(table, **columns))
    return SideView(whole, seen, SideSpec(whole=task, side=name))


def side_again(whole: "Dataset", name: str) -> "Dataset":
    """What `Dataset.__reduce__` names to make a side again in another process."""
    return whole.side(name)
