"""Statistics of a dataset that algorithms normalize inputs, scale rewards and bound values with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.types import Double, Episode


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
    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]: ...  # of each episode


def step_weights(episodes: Episodes) -> Double | None:
    """Returns the weight of each step of every episode, [n]; None where all count alike."""
    weights = getattr(episodes, "step_weights", None)  # of a mixture
    return None if weights is None else weights()


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
    own_return_std: float  # as `return_std`, of each robot's own rewards
    own_max_return: float  # as `max_return`, of any robot
    return_range: float  # of episodes' undiscounted returns: largest less smallest; 1 if all equal
    own_return_range: float  # as `return_range`, of each robot's own rewards

    @classmethod
    def measure(cls, episodes: Episodes, discount: float) -> "Statistics":
        """Reads every state and reward of a dataset, usually its train split, once, in float64.

        `discount` is the factor per step of the returns-to-go; steps of a mixture have weights.
        """
        total = squares = np.zeros(1)
        n_rows, returns, totals, weights = 0.0, [], [], step_weights(episodes)
        for index, arrays in enumerate(episodes.read("states", "rewards")):
            weight = 1.0 if weights is None else float(weights[index])
            states, rewards = (array.astype(np.float64) for array in arrays)  # [T+1, S], [T, N]
            total = total + weight * states.sum(axis=0)
            squares = squares + weight * np.square(states).sum(axis=0)
            n_rows += weight * len(states)
            returns.append(returns_to_go(rewards, discount))
            totals.append(rewards.sum(axis=0))
        if not returns:
            raise SchemaError("there are no episodes to measure; widen the filter of the dataset")
        mean = total / n_rows
        own_returns, own_totals = np.concatenate(returns), np.stack(totals)  # [n, N]
        team_returns = own_returns.mean(axis=1)
        each = None if weights is None else np.repeat(weights, [len(g) for g in returns])
        return cls(
            observation_mean=episodes.moments.observation_mean,
            observation_std=episodes.moments.observation_std,
            state_mean=mean,
            state_std=np.sqrt(np.maximum(squares / n_rows - mean**2, 0.0)),
            return_std=_deviation(team_returns, each) or 1.0,
            max_return=float(team_returns.max()),
            own_return_std=_deviation(own_returns, each) or 1.0,
            own_max_return=float(own_returns.max()),
            return_range=float(np.ptp(own_totals.mean(axis=1))) or 1.0,
            own_return_range=float(np.ptp(own_totals)) or 1.0,
        )


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
