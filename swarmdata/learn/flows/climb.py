"""Climb: how one-step actors climb critics without leaving the data that a joint flow models.

The copy's squared error is the same everywhere, and the slope of a critic is not: where a team's
actions are all alike, critics were never told what others are worth. So both scales are measured
on a batch, by the data's actions a and their mean m given c, which the flow knows:

    v      = mean over robots and components of (a - m)^2
    s      = mean deviation of Q_i over M draws from N(m_i, v), divided by sqrt(v): the slope of Q
    lambda = 2 eta v / (A s)
    loss   = - lambda mean_i clip(dQ_i / dmu_i, slope_limit s) mu_i

Beside the copy's error |mu_i - F_i|^2 / A this is the loss `anchored` of `extraction.objectives`,
times 2 v / A: actions leave the flow's by at most eta v times `slope_limit`, which is little where
the data are all alike, whatever the unit of rewards.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.extraction.objectives import bounded_gradient

N_DRAWS = 4
"""M; the slope is a mean over all robots of a batch, so that few are enough."""


class Climb:
    """The scales of K seeds, 0 until they are measured.

    Args:
        n_seeds: K.
        inverse_temperature: eta; 0 does not climb.
        slope_limit: longest slope that pulls a robot, in units of s.
        device: where the scales are.
    """

    def __init__(
        self,
        n_seeds: int,
        *,
        inverse_temperature: float,
        slope_limit: float,
        device: torch.device | str,
    ) -> None:
        self._eta, self._limit = inverse_temperature, slope_limit
        self.slope = torch.zeros(n_seeds, device=device)  # s
        self.weight = torch.zeros(n_seeds, device=device)  # lambda

    @property
    def is_measured(self) -> bool:
        """Whether the scales are known."""
        return bool(self.slope.all())

    @torch.no_grad()
    def measure(
        self,
        actions: Tensor,
        mean: Tensor,
        noise: Tensor,
        value_of: Callable[[Tensor], Tensor],
    ) -> None:
        """Takes the scales of a batch.

        Args:
            actions: of the data, [K, B, N, A].
            mean: of the data's actions, given what the flow knows, [K, B, N, A].
            noise: standard normal, of the draws, [K, B, N, M, A].
            value_of: gives the values [K, B, N, M] of each robot's M actions.
        """
        variance = (actions - mean).square().mean((1, 2, 3)).clamp(min=1e-6)  # [K]
        spread = variance.sqrt()
        drawn = mean[..., None, :] + spread[:, None, None, None, None] * noise
        values = value_of(drawn.clamp(-1, 1))
        self.slope = (values.std(3).mean((1, 2)) / spread).clamp(min=1e-6)
        self.weight = 2 * self._eta * variance / (actions.shape[3] * self.slope)

    def loss(self, pi: Tensor, values: Tensor) -> Tensor:
        """Returns the loss, [K], whose gradient is what counts.

        Args:
            pi: the actors' actions, [K, B, N, A].
            values: of them, with their gradient, [K, B, N].
        """
        pull = bounded_gradient(values, pi, self._limit * self.slope)
        return -self.weight * (pull * pi).sum(3).mean((1, 2))

    def state_dict(self) -> dict[str, Tensor]:
        """The scales, as copies."""
        return {"climb_slope": self.slope.clone(), "climb_weight": self.weight.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self.slope = state["climb_slope"].to(self.slope.device, copy=True)
        self.weight = state["climb_weight"].to(self.weight.device, copy=True)
