"""Other rewards of recorded episodes: of other weights of their terms, or of a function."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmdata.errors import SchemaError
from swarmdata.numerics.weighted_terms import weighted_rewards
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.runtime.mapped_pages import MappedReads, release_pages
from swarmdata.specs.origins import task_of
from swarmdata.specs.rules import Rewards, words_of_rewards
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset
from swarmdata.store.arrays.running_moments import train_moments
from swarmdata.store.arrays.scratch_arrays import new_arrays
from swarmdata.store.table import team_returns
from swarmdata.types import Double, Episode, Float, shortened

BLOCK_ROWS = 1 << 16  # steps whose rewards are computed together


RewardFunction = Callable[[Episode], ArrayLike]
"""Gives each robot's reward in each step of an episode, [T, N]."""


@dataclass(frozen=True, eq=False, repr=False)
class OtherRewards(ABC):
    """The episodes of a dataset with rewards that were not recorded."""

    stored: StoredDataset  # the dataset with these rewards and their returns

    def __repr__(self) -> str:
        return shortened(f"<{type(self).__name__} of {self.stored!r}: {self.summary}>")

    @property
    @abstractmethod
    def changes(self) -> dict[str, Any]:
        """What tells these rewards from the recorded ones, by name; empty: nothing does."""

    @property
    @abstractmethod
    def source(self) -> str:
        """How they were computed, a clause for the note."""

    @property
    def summary(self) -> str:
        """What is new, a few words."""
        return f"rewards with {words_of_rewards(self.changes)}"

    @property
    def note(self) -> str:
        """One paragraph about the rewards, Markdown."""
        return (
            f"> **These are other rewards.** They were computed {self.source}. The policies that "
            "chose the actions were trained with rewards of their own. The card below describes "
            "the recorded dataset.\n"
        )

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of rewards over the train split."""
        (mean,), (std,) = train_moments(self.stored, "rewards")
        return float(mean), float(std)


@dataclass(frozen=True, eq=False, repr=False)
class Reweighting(OtherRewards):
    """Rewards of other weights of the recorded terms."""

    recorded: Rewards  # the weights of the recording
    weights: Rewards  # all weights, those of the rewards

    @property
    def changes(self) -> dict[str, Any]:
        return {
            name: value for name, value in self.weights if value != getattr(self.recorded, name)
        }

    @property
    def source(self) -> str:
        changed = ", ".join(
            f"{name} {value:g} instead of {getattr(self.recorded, name):g}"
            for name, value in self.changes.items()
        )
        return f"from the recorded terms with other weights: {changed}"

    def applied_to(self, spec: TaskSpec) -> TaskSpec:
        """The same task with these weights."""
        rules = spec.rules.model_copy(update={"rewards": self.weights})
        return spec.with_updates(rules=rules)


@dataclass(frozen=True, eq=False, repr=False)
class Relabeling(OtherRewards):
    """Rewards of a function of the episodes."""

    function: str  # its name

    @cached_property
    def changes(self) -> dict[str, Any]:
        digest = hashlib.sha256(self.stored.arrays["rewards"].data).hexdigest()
        return {"function": self.function, "sha256": digest}

    @property
    def source(self) -> str:
        return f"by the function `{self.function}`"


def reweight(recorded: StoredDataset, weights: Rewards) -> Reweighting:
    """Computes the rewards of a whole dataset from its terms, with these weights of all of them.

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
    return Reweighting(_rewarded(recorded, rewards), task.rules.rewards, weights)


def relabel(
    recorded: StoredDataset, episodes: Iterable[Episode], function: RewardFunction
) -> Relabeling:
    """Computes the rewards of a whole dataset by a function of its episodes, in stored order.

    Raises:
        SchemaError: the function gives no finite rewards of each robot in each step.
        DiskFullError: the rewards are many, and no space is left.
    """
    name = getattr(function, "__qualname__", type(function).__qualname__)
    shape = recorded.arrays["rewards"].shape
    rewards = new_arrays({"rewards": (shape, np.dtype(np.float32))})["rewards"]
    for number, episode in enumerate(episodes):
        first, length = int(recorded.table.starts[number]), len(episode)
        found, expected = function(episode), (length, *shape[1:])
        if (problem := _problem(found, expected)) is not None:
            raise SchemaError(
                f"the function {name} gave {problem} for episode {number} of "
                f"{recorded.manifest.id}, expected finite rewards of shape {expected}: one of "
                "each robot in each step."
            )
        rewards[first : first + length] = found
    rewards.setflags(write=False)
    return Relabeling(_rewarded(recorded, rewards), name)


def _problem(found: ArrayLike, shape: tuple[int, ...]) -> str | None:
    """What is wrong with the rewards of an episode, None if nothing is."""
    try:
        rewards = np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError):
        return f"{found!r:.100}"
    if rewards.shape != shape:
        return f"the shape {rewards.shape}"
    if not (np.abs(rewards) <= np.finfo(np.float32).max).all():
        return "a number that is not finite in float32"
    return None


def _rewarded(recorded: StoredDataset, rewards: Float) -> StoredDataset:
    """The dataset with other rewards and their returns."""
    returns = team_returns(recorded.table, rewards)
    release_pages(rewards)
    return recorded.with_arrays({"rewards": rewards, "episodes/team_return": returns})


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
