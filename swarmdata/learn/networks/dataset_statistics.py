"""Statistics of a dataset that algorithms normalize inputs, scale rewards and bound values with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.types import Bool, Double, Episode


class ObservationMoments(Protocol):
    """The exact moments of observations."""

    @property
    def observation_mean(self) -> Double: ...  # [O]
    @property
    def observation_std(self) -> Double: ...  # [O]


class Episodes(Protocol):
    """The part of a dataset that statistics are measured on."""

    @property
    def moments(self) -> ObservationMoments: ...
    def __iter__(self) -> Iterator[Episode]: ...
    def __len__(self) -> int: ...  # episodes
    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]: ...  # of each episode


def step_weights(episodes: Episodes) -> Double | None:
    """Returns the weight of each step of every episode, [n]; None where all count alike."""
    weights = getattr(episodes, "step_weights", None)  # of a mixture
    return None if weights is None else weights()


def acting_agents(episodes: Episodes) -> Iterator[Bool | None]:
    """Yields who acts in each step of every episode, [T, N]; None where agents cannot leave."""
    for part in getattr(episodes, "parts", (episodes,)):  # of a mixture
        try:
            yield from (None if a is None else a[:-1] for (a,) in part.read("alive"))
        except UnknownNameError:
            yield from repeat(None, len(part))


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Normalization of inputs, and the range of discounted returns-to-go.

    A return-to-go is the discounted sum of rewards from a step to the end of its episode: of the
    team's (the mean over robots), or of one robot's own.
    """

    observation_mean: Double  # [O]
    observation_std: Double  # [O], 0 for features that never change: do not divide by these
    state_mean: Double  # [S]
    state_std: Double  # [S], likewise
    return_std: float  # over all steps; 1 if all returns-to-go are equal
    max_return: float  # largest return-to-go of any step
    own_return_std: float  # as `return_std`, of each robot's own rewards while it acts
    own_max_return: float  # as `max_return`, of any robot while it acts
    return_range: float  # of episodes' undiscounted returns: largest less smallest; 1 if all equal
    own_return_range: float  # as `return_range`, of own rewards of each robot that took part

    @classmethod
    def measure(cls, episodes: Episodes, discount: float) -> "Statistics":
        """Reads every state and reward of a dataset, usually its train split, once, in float64.

        `discount` is the factor per step of the returns-to-go; steps of a mixture have weights.
        """
        total = squares = np.zeros(1)
        n_rows, returns, totals, acting = 0.0, [], [], []
        weights, present = step_weights(episodes), acting_agents(episodes)
        for index, arrays in enumerate(episodes.read("states", "rewards")):
            weight, acts = 1.0 if weights is None else float(weights[index]), next(present)
            states, rewards = (array.astype(np.float64) for array in arrays)  # [T+1, S], [T, N]
            total = total + weight * states.sum(axis=0)
            squares = squares + weight * np.square(states).sum(axis=0)
            n_rows += weight * len(states)
            returns.append(returns_to_go(rewards, discount))
            totals.append(rewards.sum(axis=0))
            acting.append(np.ones(rewards.shape, np.bool_) if acts is None else acts)
        if not returns:
            raise SchemaError("there are no episodes to measure; widen the filter of the dataset")
        mean = total / n_rows
        joint_returns, joint_totals = np.concatenate(returns), np.stack(totals)  # [n, N]
        team_returns, each = joint_returns.mean(axis=1), None
        if weights is not None:
            each = np.repeat(weights, [len(g) for g in returns])
        own_returns, each_own = _of_acting(joint_returns, each, np.concatenate(acting))
        own_totals = joint_totals[np.stack([acts.any(axis=0) for acts in acting])]
        return cls(
            observation_mean=episodes.moments.observation_mean,
            observation_std=episodes.moments.observation_std,
            state_mean=mean,
            state_std=np.sqrt(np.maximum(squares / n_rows - mean**2, 0.0)),
            return_std=_deviation(team_returns, each) or 1.0,
            max_return=float(team_returns.max()),
            own_return_std=_deviation(own_returns, each_own) or 1.0,
            own_max_return=float(own_returns.max()),
            return_range=float(np.ptp(joint_totals.mean(axis=1))) or 1.0,
            own_return_range=float(np.ptp(own_totals)) or 1.0,
        )


def _of_acting(
    returns: Double, weights: Double | None, acting: Bool
) -> tuple[Double, Double | None]:
    """The returns, [n, N], of agents that act, [m], and the weights of their steps, [n] or [m]."""
    if acting.all():
        return returns, weights
    wide = None if weights is None else np.broadcast_to(weights[:, None], acting.shape)[acting]
    return returns[acting], wide


def _deviation(values: Double, weights: Double | None) -> float:
    """The standard deviation of returns, [n] or [n, N], by the weights of their steps, [n]."""
    if weights is None:
        return float(values.std())
    mean = np.average(values, axis=0, weights=weights).mean()
    squares = np.square(values - mean)
    return float(np.sqrt(np.average(squares, axis=0, weights=weights).mean()))


def returns_to_go(rewards: Double | Sequence[float], discount: float) -> Double:
    """Returns G_t = r_t + discount * G_{t+1} of rewards and has their shape, [T] or [T, N]."""
    result = np.empty(np.shape(rewards))
    following: Double | float = 0.0
    for t in range(len(rewards) - 1, -1, -1):
        following = rewards[t] + discount * following
        result[t] = following
    return result
