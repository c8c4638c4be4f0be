"""Reweighting: recorded episodes with the rewards that other weights of their terms give."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.weighted_terms import weighted_rewards
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.runtime.mapped_pages import MappedReads, release_pages
from swarmdata.specs.origins import task_of
from swarmdata.specs.rules import Rewards
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.store.arrays.scratch_arrays import new_arrays
from swarmdata.types import Double, Float, shortened

BLOCK_ROWS = 1 << 16
"""Steps whose rewards are computed together."""


@dataclass(frozen=True, eq=False, repr=False)
class Reweighting:
    """The episodes of a dataset with rewards of other weights."""

    stored: StoredDataset  # the dataset with these rewards and their returns
    recorded: Rewards  # the weights of the recording
    weights: Rewards  # all weights, those of the rewards

    def __repr__(self) -> str:
        """Shows the dataset and what is new."""
        return shortened(f"<Reweighting of {self.stored!r}: {self.summary}>")

    @property
    def summary(self) -> str:
        """The weights that differ from the recorded ones, a few words."""
        changes = (f"{name} {value:g}" for name, value in self.changes.items())
        return f"rewards with {', '.join(changes)}"

    @property
    def changes(self) -> dict[str, float]:
        """The weights that differ from those of the recording, by name."""
        return {
            name: value for name, value in self.weights if value != getattr(self.recorded, name)
        }

    @property
    def note(self) -> str:
        """One paragraph about the weights, Markdown."""
        changed = ", ".join(
            f"{name} {value:g} instead of {getattr(self.recorded, name):g}"
            for name, value in self.changes.items()
        )
        return (
            "> **These are other rewards.** They were computed from the recorded terms with other "
            f"weights: {changed}. The policies that chose the actions were trained with rewards of "
            "their own. The card below describes the recorded dataset.\n"
        )

    def applied_to(self, spec: TaskSpec) -> TaskSpec:
        """The same task with these weights."""
        rules = spec.rules.model_copy(update={"rewards": self.weights})
        return spec.with_updates(rules=rules)

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of rewards over the train split."""
        table, moments = self.stored.table, Moments()
        for index in np.flatnonzero(table.split == 0).tolist():
            first = int(table.starts[index])
            rows = self.stored.arrays["rewards"][first : first + int(table.lengths[index])]
            moments.add(rows.reshape(-1, 1))
        (mean,), (std,) = moments.result()
        return mean, std


def reweight(recorded: StoredDataset, weights: Rewards) -> Reweighting:
    """Computes the rewards of a whole dataset from its terms.

    They have 4 N bytes per step: in memory if they are few, else in a file of `new_arrays`.

    Args:
        recorded: the open files, with any observations.
        weights: of all terms, and the team's share.

    Raises:
        SchemaError: the dataset has no terms of rewards.
        SpecError: it was recorded in another environment.
        DiskFullError: the rewards are many, and no space is left.
    """
    task = task_of(recorded.recipe, "reweighting")
    if "reward_terms" not in recorded.arrays:
        raise SchemaError(
            f"{recorded.manifest.id} has no array reward_terms, so its rewards cannot have other "
            "weights. Datasets that swarmdata generates or records in its own tasks have it."
        )
    rules = task.rules.model_copy(update={"rewards": weights})
    terms = reward_terms(make_task(task.with_updates(rules=rules)))
    signed = np.array([term.signed_weight for term in terms])
    rewards = _computed(recorded.arrays["reward_terms"], signed, weights.team_share, task)
    table = recorded.table
    episodes = zip(table.starts.tolist(), (table.starts + table.lengths).tolist(), strict=True)
    returns = np.array(
        [rewards[first:end].mean(axis=1, dtype=np.float64).sum() for first, end in episodes]
    )
    release_pages(rewards)
    returns.setflags(write=False)
    arrays = {**recorded.arrays, "rewards": rewards, "episodes/team_return": returns}
    table = replace(table, team_return=returns)
    return Reweighting(replace(recorded, arrays=arrays, table=table), task.rules.rewards, weights)


def _computed(terms: Float, weights: Double, team_share: float, task: TaskSpec) -> Float:
    """The rewards of all steps, [T, N], read-only; terms are [T, N, R]."""
    rewards = new_arrays({"rewards": (terms.shape[:2], np.dtype(np.float32))})["rewards"]
    reads = MappedReads((terms, rewards))
    for first in range(0, len(terms), BLOCK_ROWS):
        block = slice(first, first + BLOCK_ROWS)
        rewards[block] = weighted_rewards(terms[block], weights, team_share, task.side_bounds)
        reads.add(terms[block], rewards[block])
    reads.release()
    rewards.setflags(write=False)
    return rewards
