"""What normalizes the numbers of a dataset: exact moments, and statistics that are ready to use."""

from dataclasses import dataclass, fields

import numpy as np

from swarmdata.store.manifest import StatisticsEntry
from swarmdata.types import Bool, Double, Float

CONSTANT_DEVIATION = 1e-3
"""Below it, a feature of observations counts as constant; networks have the same limit."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Moments:
    """Mean and standard deviation over the train split of the whole dataset, agents and time.

    They are exact: a constant feature has a deviation of 0.
    """

    observation_mean: Double  # [O]
    observation_std: Double  # [O]
    reward_mean: float
    reward_std: float

    @classmethod
    def of(cls, entry: StatisticsEntry) -> "Moments":
        return cls(
            observation_mean=np.array(entry.observation_mean),
            observation_std=np.array(entry.observation_std),
            reward_mean=entry.reward_mean,
            reward_std=entry.reward_std,
        )

    def __repr__(self) -> str:
        return (
            f"Moments({len(self.observation_mean)} features; rewards {self.reward_mean:.4g} "
            f"± {self.reward_std:.4g}; fields {', '.join(field.name for field in fields(self))})"
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Statistics:
    """What normalizes observations and rewards: `(x - mean) / std` is safe for every feature.

    A feature that is constant in the train split (a deviation below 1e-3), and rewards that are all
    the same, have a deviation of 1 here. `Dataset.moments` has the exact numbers.
    """

    observation_mean: Float  # [O]
    observation_std: Float  # [O], above 0
    reward_mean: float
    reward_std: float  # above 0
    is_constant: Bool  # [O] features whose deviation is 1 for want of one

    @classmethod
    def of(cls, moments: Moments) -> "Statistics":
        """Rounds exact moments to float32, and replaces deviations that cannot divide."""
        is_constant = moments.observation_std < CONSTANT_DEVIATION
        return cls(
            observation_mean=moments.observation_mean.astype(np.float32),
            observation_std=np.where(is_constant, 1.0, moments.observation_std).astype(np.float32),
            reward_mean=moments.reward_mean,
            reward_std=moments.reward_std or 1.0,
            is_constant=is_constant,
        )

    def __repr__(self) -> str:
        n, n_constant = len(self.is_constant), int(self.is_constant.sum())
        constant = f", {n_constant} of them constant" if n_constant else ""
        return (
            f"Statistics({n} features{constant}; rewards {self.reward_mean:.4g} "
            f"± {self.reward_std:.4g}; fields {', '.join(field.name for field in fields(self))})"
        )
