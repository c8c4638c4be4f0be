"""Offline VDN: the team's value is the mean of its robots' values, kept near the data.

Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
equation 1, over choices: recorded ones, or knots of each column of continuous actions (DecQN, Seyde
et al. 2023; offline: Beeson, Ireland & Montana, "An investigation of offline reinforcement learning
in factorisable action spaces", TMLR 2024):

    Q(o, a) = 1/N sum_i Q(o_i, a_i)

The other equations are those of `learn.factored_values`: targets, losses and the `regulariser`.

    none  double Q-learning, which overestimates what the data lack; plain without `clip_target`
    bc    choose, and bootstrap, by argmax U / temperature + log pi_b
    bcq   only choices with pi_b >= threshold max pi_b, in the target and when acting
    cql   push down all choices together, and the data's up

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
- Recorded continuous actions are interpolated between knots, not moved to the nearest one.
- Feed-forward networks, no recurrent ones: observations hold velocities. Polyak targets, Huber
  loss, LayerNorm in the utility networks, a cosine of step sizes. Observations and states are
  normalized with the dataset's statistics, rewards divided by the deviation of returns-to-go.
- Recorded action masks are kept when acting (`record.evaluate_parallel`); batches do not have them,
  so that targets may value forbidden choices, which `bc` and `bcq` leave out as nobody took them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.choices.factored_values import LOSSES, FactoredConfig, FactoredValues
from swarmdata.learn.networks.mixers import MeanMixer
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.policies.choice_policy import ChoicePolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch


@dataclass(frozen=True)
class VDNConfig(FactoredConfig):
    """Settings of offline VDN: those of every algorithm of factored values."""


class VDN:
    """K seeds of offline VDN, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        config: settings.
        statistics: of the dataset: normalization and reward scale.
        device: where to train.
    """

    Config = VDNConfig
    LOSSES = LOSSES

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: VDNConfig,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.values = FactoredValues(
            sizes, seeds, config, MeanMixer, statistics=statistics, device=device
        )

    @property
    def n_updates(self) -> int:
        """Updates made so far."""
        return self.values.n_updates

    def update(self, batch: Batch) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...]; returns losses, each [K]."""
        return self.values.update(batch)

    def policy(self, index: int) -> ChoicePolicy:
        """The policy of seed number `index`, as it is now."""
        return self.values.policy(index)

    def state_dict(self) -> dict[str, Any]:
        """Everything needed to continue, as copies."""
        return self.values.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.values.load_state_dict(state)
