"""QMIX: the team's value is a monotonic function of its robots' values that depends on the state.

Rashid et al., "QMIX: monotonic value function factorisation for deep multi-agent reinforcement
learning", ICML 2018, equations 5 and 6, over choices among knots of each action dimension
(`learn.bins`):

    Q_tot(s, o, u) = f(Q_1(o_1, u_1), ..., Q_N(o_N, u_N); s)      dQ_tot / dQ_i >= 0

trained by double Q-learning (`learn.decomposition`); f is `learn.mixers.MonotonicMixer`.

Deviations:
- One hypernetwork with a hidden layer gives all weights and biases of the mixing network; in the
  paper they are separate, and the weights are linear in the state.
- Feed-forward networks, no recurrent ones: observations hold velocities.
- Single transitions from many copies instead of whole episodes; Polyak targets instead of hard
  copies; Huber loss; actions and observations turned to the robot's target (`frame`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from swarmdata.interfaces import VecEnv
from swarmdata.learn.choices import decomposition
from swarmdata.learn.choices.bins import BinPolicy
from swarmdata.learn.networks.mixers import MonotonicMixer
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.online_algos.collection.value_learning import MIXER_STREAM, Choosing, ChoosingConfig


@dataclass(frozen=True)
class QMIXConfig(ChoosingConfig):
    """Settings of QMIX: those of every algorithm that chooses, and of the mixer."""

    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64


class QMIX:
    """K seeds of QMIX.

    Args:
        env: K E copies of a task.
        seeds: of everything random, [K].
        config: settings.
        folder: of the replay.
    """

    Config = QMIXConfig
    LOSSES = (*decomposition.LOSSES, "reward")

    def __init__(
        self, env: VecEnv, seeds: Sequence[int], config: QMIXConfig, folder: Path | str
    ) -> None:
        def build(sizes: Sizes, seeds: Sequence[int]) -> MonotonicMixer:
            return make_mixer(sizes, seeds, config)

        self._loop = Choosing(env, seeds, config, folder, build)

    @property
    def frames(self) -> int:
        """Joint steps that each seed has taken."""
        return self._loop.collector.frames

    def update(self) -> dict[str, Tensor]:
        """One round of acting and learning; returns losses, each [K], NaN before learning began."""
        return self._loop.update()

    def policy(self, index: int) -> BinPolicy:
        """The greedy policy of seed number `index`, as it is now."""
        return self._loop.policy(index)

    def prepare(self) -> bool:
        """Does nothing: the first rounds fill the replay."""
        return False

    def restart_worlds(self) -> None:
        """Begins new episodes everywhere, as loading a state does."""
        self._loop.collector.worlds.restart()

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes and the rows of the replay, as copies."""
        return self._loop.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; the folder must be that of the same run.

        Raises:
            CheckpointError: the replay in the folder does not belong to the state.
        """
        self._loop.load_state_dict(state)


def make_mixer(sizes: Sizes, seeds: Sequence[int], config: QMIXConfig) -> MonotonicMixer:
    """Makes the mixers of K seeds."""
    return MonotonicMixer(
        sizes.n_agents,
        sizes.state,
        seeds,
        MIXER_STREAM,
        embedding=config.mixer_embedding,
        hidden=config.mixer_hidden,
        device="cpu",
    )
