"""Transitions, a whole split as tensors, for critics that are fitted to the same data."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.dataset_statistics import Statistics, returns_to_go
from swarmdata.learn.networks.network_inputs import Normalizer, information
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.training.training_data import Data
from swarmdata.specs.action_scaling import action_scale
from swarmdata.types import Bool, Double, Episode, Float


@runtime_checkable
class Actor(Protocol):
    """A team whose actions are functions of the present observations, as offline runs give them."""

    def actions(self, observations: Float) -> Float: ...  # [B, N, O] -> [B, N, A]


@dataclass(frozen=True, slots=True, eq=False)
class Transitions:
    """n transitions of E episodes, float32; x has a row for each state, n + E in all.

    It takes 4 (S + N (O + A)) bytes per step, 1 GB for a million steps of four robots.
    """

    sizes: Sizes
    x: Tensor  # [n + E, S + N O] normalized states and observations
    actions: Tensor  # [n, N, A] in [-1, 1]
    rewards: Tensor  # [n] of the team
    returns: Tensor  # [n] discounted team rewards from this step to the end of its episode
    terminations: Tensor  # [n]
    acting: Tensor  # [n, N] who acted
    rows: Tensor  # [n] row of x in which the action was taken; the next row is the next state
    first: Tensor  # [E] row of x of each episode's first state
    whole: Tensor  # [k] transitions in which no agent is missing that was cut before

    @classmethod
    def read(
        cls,
        dataset: Data,
        statistics: Statistics,
        discount: float,
        device: torch.device | str = "cpu",
    ) -> "Transitions":
        """Reads all episodes of a dataset, usually one split; `discount` is of `returns`."""
        if not len(dataset):
            raise SchemaError(f"there are no episodes of {dataset.id} to read; widen the filter")
        spec, known = dataset.spec, Normalizer(statistics, "cpu")
        scale = None if spec.action_kind == "unit" else action_scale(spec)
        columns: list[tuple[NDArray[Any], ...]] = []
        for episode in dataset:
            actions = episode.actions if scale is None else scale.to_unit(episode.actions)
            team = episode.rewards.mean(axis=1, dtype=np.float64)
            alive = episode.alive
            acting = np.ones(episode.rewards.shape, np.bool_) if alive is None else alive[:-1]
            columns.append((
                _information(episode, known),
                actions if alive is None else actions * acting[:, :, None],
                team.astype(np.float32),
                _in_float32(returns_to_go(team, discount), dataset.id),
                episode.terminations,
                acting,
                _is_whole(episode),
            ))  # fmt: skip
        lengths = np.array([len(column[2]) for column in columns])
        number = np.arange(len(lengths))
        first = np.cumsum(lengths) - lengths + number
        rows = np.arange(int(lengths.sum())) + np.repeat(number, lengths)
        joined = (np.concatenate(parts) for parts in zip(*columns, strict=True))
        *by_step, is_whole = joined
        arrays = (*by_step, rows, first, np.flatnonzero(is_whole))
        tensors = (torch.from_numpy(array).to(device) for array in arrays)
        return cls(Sizes.of(next(iter(dataset))), *tensors)

    @property
    def initial_returns(self) -> Tensor:
        """The discounted return of each episode, [E]."""
        return self.returns[self.first - torch.arange(len(self.first), device=self.first.device)]

    def __len__(self) -> int:
        return len(self.rewards)


def _is_whole(episode: Episode) -> Bool:
    """Steps in which no agent is missing that was cut before, [T]."""
    if episode.alive is None:
        return np.ones(len(episode), np.bool_)
    was_cut = np.zeros_like(episode.alive)
    was_cut[1:] = np.logical_or.accumulate(np.asarray(episode.agent_truncations))
    return np.asarray(~(was_cut & ~episode.alive)[:-1].any(axis=1))


def _in_float32(returns: Double, name: str) -> Float:
    most = float(np.abs(returns).max(initial=0.0))
    if most > float(np.finfo(np.float32).max):
        raise SchemaError(
            f"returns of {name} reach {most:.2g}, expected at most 3.4e38, which float32 holds. "
            "Make the dataset with smaller rewards."
        )
    return returns.astype(np.float32)


def _information(episode: Episode, known: Normalizer) -> NDArray[Any]:
    """Returns critic inputs, x = (s, o_1, ..., o_N), normalized, [T+1, S + N O]."""
    # copies, because torch has no read-only tensors
    states = known.states(torch.tensor(episode.states))
    observations = known.observations(torch.tensor(episode.observations))
    return information(states[None], observations[None])[0].numpy()


def actions_of(policies: Sequence[object], dataset: Data) -> Float:
    """Returns the actions of K policies in every state of a dataset, float32 [K, n + E, N, A].

    Rows are those of `Transitions.x`. Robots that have left an episode do nothing, except in the
    state in which they were cut: there, they would have gone on.
    """
    actors = [policy for policy in policies if isinstance(policy, Actor)]
    if silent := sorted({type(p).__name__ for p in policies if not isinstance(p, Actor)}):
        raise SchemaError(
            f"{', '.join(silent)} has no `actions(observations)`, expected policies whose actions "
            "are functions of what the robots see now: what others would have done in recorded "
            "states is not known."
        )
    answers: list[Float] = []
    for episode in dataset:
        observations = np.array(episode.observations)
        joint = np.stack([actor.actions(observations) for actor in actors])
        joint = joint.astype(np.float32, copy=False)
        if episode.alive is not None:
            acts = episode.alive.copy()
            acts[1:] |= np.asarray(episode.agent_truncations)
            joint = joint * acts[:, :, None]
        answers.append(joint)
    return np.concatenate(answers, axis=1)
