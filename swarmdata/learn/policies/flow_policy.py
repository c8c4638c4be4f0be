"""FlowPolicy, a policy of one seed whose robots turn noise into actions, each on its own."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from swarmdata.behavior_policies.noise import counters
from swarmdata.learn.policies.drawn_policy import DrawnPolicy
from swarmdata.numerics.random import normal
from swarmdata.types import Double, Step

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


def drawn_noise(step: Step, n_agents: int, action_size: int, redraw: Redraw) -> Double:
    """Returns the noise of all robots, standard normal, [E, N, A], a function of episode and time.

    Args:
        step: of E copies.
        n_agents: N.
        action_size: A.
        redraw: when it is drawn anew.
    """
    times = np.zeros_like(step.times) if redraw == "episode" else step.times
    return normal(counters(step._replace(times=times), "policy", n_agents, action_size))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlowPolicy(DrawnPolicy):
    """A `DrawnPolicy` of noise, which robots turn into actions in one step.

    The noise is drawn once for an episode, or anew in every step. With noise `team` every robot
    computes that of all robots; with `own` they need not agree on anything.

    Attributes:
        n_agents: N, the robots it was trained for.
        noise: what a robot knows of the team's noise.
        redraw: when noise is drawn anew.
        noise_scale: factor on the noise when acting.
    """

    n_agents: int
    noise: Noise
    redraw: Redraw
    noise_scale: float = 1.0

    def draw(self, step: Step) -> Double:
        """Returns the noise of all robots, normal of deviation `noise_scale`, [E, N, A]."""
        size = self.layers[-1].weight.shape[-1]
        return self.noise_scale * drawn_noise(step, self.n_agents, size, self.redraw)

    def drawn_features(self, step: Step) -> Tensor:
        """Returns what each robot knows of the team's noise, float64 [E, N, `noise_size`]."""
        return known_noise(torch.from_numpy(self.draw(step)), self.noise)
