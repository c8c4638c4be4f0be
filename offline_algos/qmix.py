"""Offline QMIX: the team's value is a monotonic function of its robots' values.

Rashid et al., "QMIX: monotonic value function factorisation for deep multi-agent reinforcement
learning", ICML 2018, equations 4 and 5, over choices: recorded ones, or bins of each column of
continuous actions. `offline_algos.vdn` explains the symbols, the rule and the `regulariser`, and
names the sources:

    Q_j(x, a) = f_j(Q_j(o_1, a_1), ..., Q_j(o_N, a_N); x)         df_j / dQ_j(o_i, a_i) >= 0

f is `mixers.HyperMixer`, and x = (state, all observations), normalized. Without the mixing network,
the algorithm is `vdn`, whose targets and losses it has.

Deviations: those of `offline_algos.vdn` but the first, and
- the hypernetwork sees x, the paper's the state alone, which says nothing of obstacles here.
- One hypernetwork with a hidden layer gives all weights and biases of the mixing network; in the
  paper they are separate, and the weights are linear in the state.
- Each of the two utility networks has a mixing network of its own.
"""

from dataclasses import dataclass

from torch import Tensor

from swarmdata.learn.choices.utility_networks import (
    MIXER_STREAM,
    N_CRITICS,
    DecompositionConfig,
    by_critic,
)
from swarmdata.learn.networks.mixers import HyperMixer
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.setup import Setup
from swarmdata.offline_algos.vdn import VDN


@dataclass(frozen=True)
class QMIXConfig(DecompositionConfig):
    """Settings of offline QMIX: those of every value decomposition, and of the mixer."""

    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64


class QMIX(VDN):
    """K seeds of offline QMIX, trained at once."""

    Config = QMIXConfig
    FIELDS = VDN.FIELDS

    def __init__(self, setup: Setup, config: QMIXConfig) -> None:
        self.mixer = HyperMixer(
            setup.sizes.n_agents, setup.sizes.information, setup.seeds, MIXER_STREAM,
            embedding=config.mixer_embedding, hidden=config.mixer_hidden, device=setup.device,
            n_critics=N_CRITICS,
        )  # fmt: skip
        super().__init__(setup, config, self.mixer.network)

    def mix(self, values: Tensor, x: Tensor, mixer: StackedMLP | None = None) -> Tensor:
        """Returns f_j of robots' values, [K, J, B] of [K, J, B, N], equations 4 and 5."""
        return by_critic(self.mixer(values.flatten(0, 1), x.repeat_interleave(N_CRITICS, 0), mixer))
