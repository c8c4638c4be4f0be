"""LatentPolicy, a policy of one seed whose robots share a latent for the length of an episode."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.torch_policy import outputs_of
from swarmdata.numerics.random import STREAMS, derive
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Double, Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False)
class LatentPolicy:
    """Actors on normalized observations and the latent of a recorded episode, the same for all.

    In every episode the team takes the latent of one recorded episode, chosen by the episode's
    seed: before an episode the robots must agree on one number, and nothing is sent afterwards.

    `log_probs` is that of the action given the latent: 0 for the action taken.

    It computes in float64 on the CPU and rounds once at the end, as `TorchPolicy` does.

    Attributes:
        layers: the actors' weights, float64, R = 1.
        latents: of the recorded episodes, float64 [M, D].
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        frame: in which the actors see and act; None for the world's.
    """

    layers: Sequence[Layer]
    latents: Tensor
    observation_mean: Tensor
    observation_std: Tensor
    frame: Frame | None = None
    uses_state: bool = False
    _last: LastMeans = field(default_factory=LastMeans, init=False, repr=False)

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the latent is a function of the step's seeds."""

    def act(self, step: Step) -> Float:
        """Returns joint actions, float32 [E, N, A].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        return self._last.keep(step, self._actions(step)).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns 0 for the actions that this episode's latent gives, else -infinity, [E, N]."""
        kept = self._last.recall(step)  # right after `act`: the network need not run again
        chosen = self._actions(step) if kept is None else kept
        return certain_log_probs(chosen.astype(np.float32), actions)

    def draw(self, step: Step) -> Tensor:
        """Returns the latent of each episode, [E, D]."""
        bits = derive(step.seeds, STREAMS["policy"])
        return self.latents[torch.from_numpy((bits % len(self.latents)).astype(np.int64))]

    def _actions(self, step: Step) -> Double:
        framed = step.observations if self.frame is None else self.frame.inputs(step.observations)
        outputs = outputs_of(
            self.layers, framed, self.observation_mean, self.observation_std, "shared",
            beside=self.draw(step)[:, None].expand(-1, framed.shape[1], -1),
        )  # fmt: skip
        actions = in_world(self.frame, step.observations, outputs.tanh().numpy())
        return actions.astype(np.float64)
