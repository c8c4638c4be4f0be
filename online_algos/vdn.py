"""VDN: the team's value is the mean of its robots' values, which see what the robots see.

Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
section 3, over choices among knots of each action dimension (`learn.bins`):

    Q_tot(o, u) = 1/N sum_i Q_i(o_i, u_i)      Q_i(o_i, u_i) = 1/D sum_d U_d(o_i, u_id)

trained by double Q-learning (`learn.decomposition`).

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
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
from swarmdata.learn.networks.mixers import MeanMixer
from swarmdata.online_algos.collection.value_learning import Choosing, ChoosingConfig


@dataclass(frozen=True)
class VDNConfig(ChoosingConfig):
    """Settings of VDN: those of every algorithm that chooses."""


class VDN:
    """K seeds of VDN.

    Args:
        env: K E copies of a task.
        seeds: of everything random, [K].
        config: settings.
        folder: of the replay.
    """

    Config = VDNConfig
    LOSSES = (*decomposition.LOSSES, "reward")

    def __init__(
        self, env: VecEnv, seeds: Sequence[int], config: VDNConfig, folder: Path | str
    ) -> None:
        self._loop = Choosing(env, seeds, config, folder, lambda *_: MeanMixer())

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
