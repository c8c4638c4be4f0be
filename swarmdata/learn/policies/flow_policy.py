"""FlowPolicy, a policy of one seed whose robots turn noise into actions, each on its own."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from swarmdata.behavior_policies.noise import counters
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.torch_policy import outputs_of
from swarmdata.numerics.random import normal
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Double, Float, Int, Step

Noise = Literal["team", "own"]
"""What a robot knows of the team's noise: its own and that of all, or its own alone."""

Redraw = Literal["episode", "step"]
"""When noise is drawn anew: at the start of every episode, or in every step."""


def noise_size(noise: Noise, n_agents: int, action_size: int) -> int:
    """Returns how many numbers of noise a robot's network sees."""
    return action_size * (1 if noise == "own" else 1 + n_agents)


def known_noise(values: Tensor, noise: Noise) -> Tensor:
    """Returns what each robot knows of the team's noise, [..., N, `noise_size`].

    Args:
        values: the noise of all robots, [..., N, A].
        noise: how much of it they know; of `team` a robot sees its own first.
    """
    if noise == "own":
        return values
    n_agents = values.shape[-2]
    team = values.flatten(-2)[..., None, :].expand(*values.shape[:-2], n_agents, -1)
    return torch.cat([values, team], -1)


@dataclass(frozen=True, slots=True, eq=False)
class FlowPolicy:
    """One-step actors on normalized observations and noise, shared by all robots.

    The noise is a function of the episode's seed, and of the time if it is redrawn in every step.
    With noise `team` every robot computes that of all robots: before an episode they must agree on
    one seed, and nothing is sent afterwards. With `own` they need not agree on anything.

    `log_probs` is that of the action given the noise, which the episode's seed decides: 0 for the
    action taken. The density over noise has no closed form, so data that such a policy records
    carry no importance weights.

    It computes in float64 on the CPU and rounds once at the end, as `TorchPolicy` does.

    Attributes:
        layers: the actors' weights, float64, R = 1.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        n_agents: N, the robots it was trained for.
        noise: what a robot knows of the team's noise.
        redraw: when noise is drawn anew.
        noise_scale: factor on the noise when acting.
        frame: in which the actors see and act; None for the world's.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    n_agents: int
    noise: Noise
    redraw: Redraw
    noise_scale: float = 1.0
    frame: Frame | None = None
    uses_state: bool = False
    _last: LastMeans = field(default_factory=LastMeans, init=False, repr=False)

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: noise is a function of the step's seeds and times."""

    def act(self, step: Step) -> Float:
        """Returns joint actions, float32 [E, N, A].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        return self._last.keep(step, self._actions(step)).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns 0 for the actions that the noise of this step gives, else -infinity, [E, N]."""
        kept = self._last.recall(step)  # right after `act`: the network need not run again
        chosen = self._actions(step) if kept is None else kept
        return certain_log_probs(chosen.astype(np.float32), actions)

    def draw(self, step: Step) -> Double:
        """Returns the noise of all robots, normal of deviation `noise_scale`, [E, N, A]."""
        times = np.zeros_like(step.times) if self.redraw == "episode" else step.times
        size = self.layers[-1].weight.shape[-1]
        return self.noise_scale * normal(
            counters(step._replace(times=times), "policy", self.n_agents, size)
        )

    def _actions(self, step: Step) -> Double:
        framed = step.observations if self.frame is None else self.frame.inputs(step.observations)
        outputs = outputs_of(
            self.layers, framed, self.observation_mean, self.observation_std, "shared",
            beside=known_noise(torch.from_numpy(self.draw(step)), self.noise),
        )  # fmt: skip
        actions = in_world(self.frame, step.observations, outputs.tanh().numpy())
        return actions.astype(np.float64)
