"""Offline QMIX: the team's value is a monotonic function of its robots' values and of the state.

Rashid et al., "QMIX: monotonic value function factorisation for deep multi-agent reinforcement
learning", ICML 2018, equations 4 and 5, over choices: recorded ones, or knots of each column of
continuous actions (`offline_algos.vdn` names the sources):

    Q(s, o, a) = f(Q(o_1, a_1), ..., Q(o_N, a_N); s)      df / dQ(o_i, a_i) >= 0

f is `learn.mixers.MonotonicMixer` on the normalized state. The other equations are those of
`learn.factored_values`: targets, losses and the `regulariser`, `none`, `bc`, `bcq` or `cql`, which
`offline_algos.vdn` explains.

Deviations: those of `offline_algos.vdn` but the first, and
- one hypernetwork with a hidden layer gives all weights and biases of the mixing network; in the
  paper they are separate, and the weights are linear in the state.
- Each twin has a mixing network of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.choices.factored_values import (
    LOSSES,
    MIXER_STREAM,
    TWINS,
    FactoredConfig,
    FactoredValues,
)
from swarmdata.learn.networks.mixers import MonotonicMixer
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.policies.choice_policy import ChoicePolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch


@dataclass(frozen=True)
class QMIXConfig(FactoredConfig):
    """Settings of offline QMIX: those of every algorithm of factored values, and of the mixer."""

    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64


class QMIX:
    """K seeds of offline QMIX, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        config: settings.
        statistics: of the dataset: normalization and reward scale.
        device: where to train.
    """

    Config = QMIXConfig
    LOSSES = LOSSES

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: QMIXConfig,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        def mixer() -> MonotonicMixer:
            return MonotonicMixer(
                sizes.n_agents,
                sizes.state,
                seeds,
                MIXER_STREAM,
                embedding=config.mixer_embedding,
                hidden=config.mixer_hidden,
                device=device,
                n_twins=TWINS,
            )

        self.values = FactoredValues(
            sizes, seeds, config, mixer, statistics=statistics, device=device
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
