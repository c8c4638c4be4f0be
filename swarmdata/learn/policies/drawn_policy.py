"""DrawnPolicy, what the policies share that act by observations and a draw of the seed."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.torch_policy import StepFunction, outputs_of
from swarmdata.perception.frames import Frame, in_world
from swarmdata.types import Float, Step


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrawnPolicy(StepFunction):
    """Actors on normalized observations and what the team drew, shared by all robots.

    The draw is a function of the episode's seed: before an episode the robots must agree on one
    number, and nothing is sent afterwards. `log_probs` is that of the action given the draw, 0 for
    the action taken. The density over draws has no closed form, so data that such a policy records
    carry no importance weights.

    It computes in float64 on the CPU and rounds once at the end, as `TorchPolicy` does.

    Attributes:
        layers: the actors' weights, float64, R = 1.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        frame: in which the actors see and act; None for the world's.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    frame: Frame | None = None
    uses_state: bool = False

    @abstractmethod
    def drawn_features(self, step: Step) -> Tensor:
        """Returns what each robot knows of the draw, float64 [E, N, D]."""

    def step_actions(self, step: Step) -> Float:
        framed = step.observations if self.frame is None else self.frame.inputs(step.observations)
        outputs = outputs_of(
            self.layers, framed, self.observation_mean, self.observation_std, "shared",
            beside=self.drawn_features(step),
        )  # fmt: skip
        actions = in_world(self.frame, step.observations, outputs.tanh().numpy())
        return actions.astype(np.float32)
