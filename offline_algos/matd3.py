"""MATD3 offline: MADDPG with twin critics, held to the data by a tenth of the weight of the values.

MADDPG (Lowe et al. 2017, eq. 6) with the two critics, smoothed targets and delayed actors of TD3
(Ackermann et al. 2019, section 4), trained on recorded data: the first stage of `maddpg_bc`, with
its equations and deviations, and alpha 10 for 2.5.

Deviations:
- The papers learn in the task, without an imitation term, which is 1 / alpha as strong as the
  values. Without it, critics are asked about actions that the data lack.
"""

from dataclasses import dataclass
from typing import ClassVar

from swarmdata.learn.training.actor_critic import ACTOR_CRITIC_SPACE, Extraction
from swarmdata.learn.training.settings import LogUniform, Space
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig


@dataclass(frozen=True)
class MATD3Config(MADDPGBCConfig):
    """The settings of `maddpg_bc`, in one stage; one setting for all datasets."""

    extraction: Extraction = "joint"
    rl_weight: float = 10.0  # alpha


class MATD3(MADDPGBC):
    """K seeds of actors and two critics, trained at once."""

    Config = MATD3Config
    SPACE: ClassVar[Space] = {**ACTOR_CRITIC_SPACE, "rl_weight": LogUniform(0.3, 100.0)}
