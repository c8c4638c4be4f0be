"""LatentPolicy, a policy of one seed whose robots share a latent for the length of an episode."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.policies.drawn_policy import DrawnPolicy
from swarmdata.numerics.random import STREAMS, derive
from swarmdata.types import Step


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LatentPolicy(DrawnPolicy):
    """A `DrawnPolicy` of latents: in every episode the team takes that of one recorded episode.

    Attributes:
        latents: of the recorded episodes, float64 [M, D].
    """

    latents: Tensor

    def draw(self, step: Step) -> Tensor:
        """Returns the latent of each episode, [E, D]."""
        bits = derive(step.seeds, STREAMS["policy"])
        return self.latents[torch.from_numpy((bits % len(self.latents)).astype(np.int64))]

    def drawn_features(self, step: Step) -> Tensor:
        """Returns the latent of each episode, the same for all robots, [E, N, D]."""
        return self.draw(step)[:, None].expand(-1, step.observations.shape[1], -1)
