"""Policies that act by observations and a draw of the seed: noise of flows, or a latent."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from swarmdata.behavior_policies.noise import counters
from swarmdata.learn.flows.one_step_actor import Noise, Redraw, known_noise
from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters, answer
from swarmdata.learn.policies.recurrent_policy import Remembering
from swarmdata.learn.policies.torch_policy import StepFunction, outputs_of, policy_repr
from swarmdata.numerics.random import STREAMS, derive, normal
from swarmdata.perception.frames import Frame, in_world
from swarmdata.types import Double, Float, Step


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrawnPolicy(StepFunction):
    """Actors on normalized observations and what the team drew, shared by all robots.

    The draw is a function of the episode's seed: before an episode the robots must agree on one
    number, and nothing is sent afterwards. `log_probs` is that of the action given the draw, 0 for
    the action taken. The density over draws has no closed form, so data that such a policy records
    carry no importance weights. It computes in float64, as `TorchPolicy` does.
    """

    parameters: ClassVar[Parameters] = "shared"

    layers: Sequence[Layer]  # the actors' weights, float64, R = 1
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    frame: Frame | None = None  # in which the actors see and act; None for the world's
    uses_state: bool = False

    @abstractmethod
    def drawn_features(self, step: Step) -> Tensor:
        """Returns what each robot knows of the draw, float64 [E, N, D]."""

    def step_actions(self, step: Step) -> Float:
        outputs = outputs_of(self, step.observations, beside=self.drawn_features(step))
        actions = in_world(self.frame, step.observations, outputs.tanh().numpy())
        return actions.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LatentPolicy(DrawnPolicy):
    """A `DrawnPolicy` of latents: in every episode the team takes that of one recorded episode."""

    latents: Tensor  # of the recorded episodes, float64 [M, D]

    __repr__ = policy_repr

    def draw(self, step: Step) -> Tensor:
        """Returns the latent of each episode, [E, D]."""
        bits = derive(step.seeds, STREAMS["policy"])
        return self.latents[torch.from_numpy((bits % len(self.latents)).astype(np.int64))]

    def drawn_features(self, step: Step) -> Tensor:
        """Returns the latent of each episode, the same for all robots, [E, N, D]."""
        return self.draw(step)[:, None].expand(-1, step.observations.shape[1], -1)


class TeamNoise:
    """The draw of policies that turn noise into actions."""

    __slots__ = ()

    def draw(self: Any, step: Step) -> Double:
        """Returns the noise of all robots, normal of deviation `noise_scale`, [E, N, A]."""
        times = np.zeros_like(step.times) if self.redraw == "episode" else step.times
        size = self.layers[-1].weight.shape[-1]
        numbers = counters(step._replace(times=times), "policy", self.n_agents, size)
        return self.noise_scale * normal(numbers)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlowPolicy(TeamNoise, DrawnPolicy):
    """A `DrawnPolicy` of noise, which robots turn into actions in one step.

    The noise is drawn once for an episode, or anew in every step. With noise `team` every robot
    computes that of all robots; with `own` they need not agree on anything.
    """

    n_agents: int  # N, the robots it was trained for
    noise: Noise  # what a robot knows of the team's noise
    redraw: Redraw  # when noise is drawn anew
    noise_scale: float = 1.0  # factor on the noise when acting

    __repr__ = policy_repr

    def drawn_features(self, step: Step) -> Tensor:
        """Returns what each robot knows of the team's noise, float64 [E, N, `noise_size`]."""
        return known_noise(torch.from_numpy(self.draw(step)), self.noise)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecurrentFlowPolicy(TeamNoise, Remembering):
    """Robots turn the noise of a `FlowPolicy` into actions, given their past of the episode."""

    parameters: ClassVar[Parameters] = "shared"

    n_agents: int  # N, the robots it was trained for
    noise: Noise  # what a robot knows of the team's noise
    redraw: Redraw  # when noise is drawn anew
    noise_scale: float = 1.0  # factor on the noise when acting
    frame: Frame | None = None  # in which the actors see and act; None for the world's
    uses_state: bool = False

    __repr__ = policy_repr

    def local_actions(self, step: Step, features: Tensor, memory: Tensor) -> Tensor:
        noise = known_noise(torch.from_numpy(self.draw(step)), self.noise)
        known = torch.cat([features, memory, noise], -1)
        return answer(self.layers[N_GATE_LAYERS:], known, "shared").tanh()
