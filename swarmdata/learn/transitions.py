"""Transitions, a whole split as tensors: what a critic reads when it is fitted over and over."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.data import Data
from swarmdata.learn.inputs import standardize
from swarmdata.learn.statistics import Statistics, returns_to_go
from swarmdata.origins import RecordedSpec
from swarmdata.scaling import action_scale
from swarmdata.types import Double, Episode, Float


class Actor(Protocol):
    """A policy without memory, of a team; every policy of an offline run is one."""

    def actions(self, observations: Float) -> Float: ...  # [B, N, O] -> [B, N, A]


@dataclass(frozen=True, slots=True, eq=False)
class Transitions:
    """n transitions of E episodes, float32; x has a row for each state, n + E in all.

    It takes 4 (S + N (O + A)) bytes per step, 1 GB for a million steps of four robots.
    """

    x: Tensor  # [n + E, S + N O] normalized states and observations
    actions: Tensor  # [n, N, A] in [-1, 1]
    rewards: Tensor  # [n] of the team
    returns: Tensor  # [n] discounted team rewards from this step to the end of its episode
    terminations: Tensor  # [n]
    here: Tensor  # [n] row of x in which the action was taken; the next row is what it reached
    first: Tensor  # [E] row of x of each episode's first state

    @classmethod
    def read(
        cls,
        dataset: Data,
        statistics: Statistics,
        discount: float,
        device: torch.device | str = "cpu",
    ) -> "Transitions":
        """Reads all episodes of a dataset, usually one split.

        Args:
            dataset: what to read.
            statistics: for the normalization.
            discount: factor per step of `returns`.
            device: where the tensors are.

        Raises:
            SchemaError: there are no episodes, or the actions are not continuous and bounded.
        """
        if not len(dataset):
            raise SchemaError(f"there are no episodes of {dataset.id} to read; widen the filter")
        spec = dataset.spec
        scale = action_scale(spec) if isinstance(spec, RecordedSpec) else None
        columns: list[tuple[NDArray[Any], ...]] = []
        for episode in dataset:
            actions = episode.actions if scale is None else scale.to_unit(episode.actions)
            team = episode.rewards.mean(axis=1, dtype=np.float64)
            columns.append((
                _information(episode, statistics),
                actions if episode.alive is None else actions * episode.alive[:-1, :, None],
                team.astype(np.float32),
                returns_to_go(team, discount).astype(np.float32),
                episode.terminations,
            ))  # fmt: skip
        lengths = np.array([len(rows[2]) for rows in columns])
        shifts = np.repeat(np.arange(len(lengths)), lengths)
        starts = np.cumsum(lengths) - lengths + np.arange(len(lengths))
        joined = (np.concatenate(rows) for rows in zip(*columns, strict=True))
        here = np.arange(int(lengths.sum())) + shifts
        return cls(*(torch.from_numpy(array).to(device) for array in (*joined, here, starts)))

    def __len__(self) -> int:
        """Number of transitions, n."""
        return len(self.rewards)


def _information(episode: Episode, statistics: Statistics) -> Float:
    """What critics see besides actions, x = (s, o_1, ..., o_N), normalized, [T+1, S + N O]."""
    parts = (
        (episode.states, statistics.state_mean, statistics.state_std),
        (episode.observations, statistics.observation_mean, statistics.observation_std),
    )
    normal = [standardize(*(torch.from_numpy(np.float32(part)) for part in each)) for each in parts]
    x: Float = torch.cat([part.flatten(1) for part in normal], 1).numpy()
    return x


def actions_of(policies: Sequence[Actor], dataset: Data) -> Float:
    """Returns what K policies do in every state of a dataset, float32 [K, n + E, N, A].

    Rows are those of `Transitions.x`. It takes 4 K N A bytes per step, 32 MB for each policy and
    million steps of four robots. Who has left an episode does nothing.

    Args:
        policies: whose actions are functions of the observations alone.
        dataset: what the transitions were read from.

    Raises:
        SchemaError: a policy does not tell its actions, or was trained on other observations.
    """
    silent = [type(policy).__name__ for policy in policies if not hasattr(policy, "actions")]
    if silent:
        raise SchemaError(
            f"{', '.join(silent)} has no `actions(observations)`, expected policies whose actions "
            "are functions of what the robots see now: what they would have done in recorded "
            "states is not known otherwise."
        )
    answers: list[Double | Float] = []
    for episode in dataset:
        seen = np.ascontiguousarray(episode.observations)
        joint = np.stack([policy.actions(seen) for policy in policies])
        answers.append(joint if episode.alive is None else joint * episode.alive[:, :, None])
    return np.concatenate(answers, axis=1).astype(np.float32, copy=False)
