"""Filtered behavior cloning: imitates the episodes with the highest returns, and no others.

Called BC-10% or %BC (Chen et al. 2021, "Decision Transformer", section 5.1): the baseline that
any finer use of rewards must beat.

    G_k = sum_t mean_i r_{k, t, i}              return of episode k
    m   = ceil(max(f n, min(n_min, n / 2)))     episodes that are kept of n
    D'  = {k : G_k >= the m-th largest of G_1, ..., G_n}
    min_pi  E_{(o, a) ~ D'}  1/N sum_i |pi(o_i, i) - a_i|^2, of choices -1/N sum_i log pi(a_i | o_i)

A tenth of a small dataset is too little to imitate: errors of a clone of few episodes cost more
than their higher returns gain. So n_min episodes are kept at least, of small datasets half of all.

Deviations:
- The paper has no n_min, and `filtered_bc` had none in the published studies.
- Whole episodes are kept, ties included, so that D' can be more than the fraction f. The run's
  `min_return` and `n_episodes` say what was kept.
- The number of updates is that of behavior cloning, though the data are fewer.
- Observations are normalized with the statistics of the whole train split; in another frame than
  the world's, with those of the selected episodes.
- All others of `offline_algos.bc`.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.types import Double


@dataclass(frozen=True)
class FilteredBCConfig(BCConfig):
    """Behavior cloning of the best episodes."""

    fraction: float = 0.1  # f; Chen et al. 2021, table 3: of 10, 25, 40 and 100 %, 10 % is usual
    min_episodes: int = 250  # n_min

    def __post_init__(self) -> None:
        if not 0 < self.fraction <= 1:
            raise SchemaError(
                f"fraction is {self.fraction}, expected above 0 and at most 1: the part of the "
                "episodes to imitate"
            )
        if self.min_episodes < 1:
            raise SchemaError(f"min_episodes is {self.min_episodes}, expected at least 1")

    def least_return(self, returns: Double) -> float:
        """Returns the return of the last episode that is kept, the best of returns [n] first."""
        if not len(returns):
            raise SchemaError("there are no episodes to choose from; widen the dataset's filter")
        # 0.1 * 30 is a little more than 3 in floating point, and 3 are meant
        n = len(returns)
        n_kept = math.ceil(max(self.fraction * n, min(self.min_episodes, n / 2)) - 1e-9)
        return float(np.sort(returns)[-n_kept])


class FilteredBC(BC):
    """K actors trained as those of `BC`, which is all that it is: only the data differ."""

    Config = FilteredBCConfig
    FIELDS = BC.FIELDS
    SPACE: ClassVar[Space] = {
        **BC.SPACE,
        "fraction": LogUniform(0.03, 0.5),
        "min_episodes": Choice((1, 250)),  # on small data, 250 decides alone
    }
