"""QMIX: the team's value is a monotonic function of its robots' values.

Rashid et al., "QMIX: monotonic value function factorisation for deep multi-agent reinforcement
learning", ICML 2018, equations 5 and 6, over choices among bins of each action dimension
(`learn.choices.bins`), trained by double Q-learning (van Hasselt et al. 2016, equation 4):

    Q_tot(x, u) = f(Q_1(o_1, u_1), ..., Q_N(o_N, u_N); x)         dQ_tot / dQ_i >= 0

f is `mixers.HyperMixer`, and x = (state, all observations). Without the mixing network it is
`online_algos.vdn`, whose targets and loss it has.

Deviations: those of `online_algos.vdn` but the first, and
- the hypernetwork sees x, the paper's the state alone, which says nothing of obstacles here.
- One hypernetwork with a hidden layer gives all weights and biases of the mixing network; in the
  paper they are separate, and the weights are linear in the state.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from swarmdata.learn.networks.mixers import HyperMixer
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.setup import Sizes
from swarmdata.online_algos.vdn import MIXER_STREAM, VDN, VDNConfig, VDNLearner


@dataclass(frozen=True)
class QMIXConfig(VDNConfig):
    """Settings of QMIX: those of every value decomposition, and of the mixer."""

    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64
    exploration: float = 0.05  # less than VDN, whose values do not diverge: docs/online-learning.md


class QMIXLearner(VDNLearner):
    """K seeds of utility networks and a mixer, trained on batches of bins."""

    def __init__(self, sizes: Sizes, seeds: Sequence[int], config: QMIXConfig) -> None:
        self.mixer = HyperMixer(
            sizes.n_agents, sizes.information, seeds, MIXER_STREAM,
            embedding=config.mixer_embedding, hidden=config.mixer_hidden, device="cpu",
            n_critics=config.n_critics,
        )  # fmt: skip
        super().__init__(sizes, seeds, config, self.mixer.network)

    def mix(self, values: Tensor, x: Tensor, network: StackedMLP | None = None) -> Tensor:
        k, n_critics = values.shape[:2]
        mixed = self.mixer(values.flatten(0, 1), x.repeat_interleave(n_critics, 0), network)
        return mixed.view(k, n_critics, -1)


class QMIX(VDN):
    """K seeds of QMIX in K E copies of a task, with their replay in a folder."""

    Config = QMIXConfig
    Learner = QMIXLearner
