"""MixturePolicy, the greedy policy of one seed whose actions have several modes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.mixtures import Mixture
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.torch_policy import Memoryless, outputs_of
from swarmdata.perception.frames import Frame, in_world
from swarmdata.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class MixturePolicy(Memoryless):
    """Each robot takes the likeliest mode of its action, given what it observes now.

    It computes in float64 on the CPU and rounds once at the end, as `TorchPolicy` does.

    Attributes:
        layers: the actor's weights, float64, R = 1; its outputs are a `Mixture`.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        n_components: of the mixture.
        deviation: of each component.
        frame: in which the actor sees and acts; None for the world's.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    n_components: int
    deviation: float
    frame: Frame | None = None
    uses_state: bool = False

    @torch.no_grad()
    def actions(self, observations: Float) -> Float:
        """Returns the actors' actions, float32 [E, N, A], for observations [E, N, O].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        framed = observations if self.frame is None else self.frame.inputs(observations)
        mean, std = self.observation_mean, self.observation_std
        outputs = outputs_of(self.layers, framed, mean, std, "shared")
        local = Mixture.of(outputs, self.n_components).mode(self.deviation)
        return in_world(self.frame, observations, local.numpy()).astype(np.float32)
