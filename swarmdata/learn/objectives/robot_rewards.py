"""RobotRewards: what each robot's value is the return of, in which unit, and its bound."""

import math
from typing import Literal

from torch import Tensor

from swarmdata.learn.training.dataset_statistics import Statistics

Reward = Literal["own", "team"]
"""Whether a robot's value is of its own rewards, or of the mean over the team."""


class RobotRewards:
    """Makes the scaled rewards that critics of each robot learn from.

    A mean over N robots spreads what one of them caused over all: its share falls with 1 / N, and
    the rewards of the others are noise. Own rewards are for tasks in which robots are rewarded for
    what they do themselves.

    Attributes:
        scale: 1 / standard deviation of the returns-to-go.
        max_value: R*, the largest return-to-go, in scaled rewards; infinite if it bounds nothing.
        return_range: largest less smallest undiscounted return of an episode, in scaled rewards.

    Args:
        statistics: of the dataset.
        reward: whose.
        clip_target: whether R* bounds values.
    """

    def __init__(
        self, statistics: Statistics, reward: Reward, *, clip_target: bool = False
    ) -> None:
        is_own = reward == "own"
        self._is_own = is_own
        self.scale = 1 / (statistics.own_return_std if is_own else statistics.return_std)
        largest = statistics.own_max_return if is_own else statistics.max_return
        self.max_value = largest * self.scale if clip_target else math.inf
        width = statistics.own_return_range if is_own else statistics.return_range
        self.return_range = width * self.scale

    def __call__(self, rewards: Tensor) -> Tensor:
        """Returns scaled rewards, [K, B, N], of rewards as recorded, [K, B, N]."""
        if not self._is_own:
            rewards = rewards.mean(-1, keepdim=True).expand_as(rewards)
        return rewards * self.scale
