"""Densities of actions with several modes: mixtures of Gaussians of one fixed deviation.

With M components of weights w_m and means mu_m, and a deviation sigma of each number of an action,

    p(a) ~ sum_m w_m exp(-|a - mu_m|^2 / 2 sigma^2)

With one component, the likelihood is a squared error. A squared error of data with two modes is
least between them, where no data are; components find one mode each. Greedy policies take the mean
at which the density is largest.
"""

from typing import NamedTuple

import torch
from torch import Tensor


class Mixture(NamedTuple):
    """Mixtures of M components over actions of A numbers."""

    log_weights: Tensor  # [..., M]
    means: Tensor  # [..., M, A]

    @classmethod
    def of(cls, outputs: Tensor, n_components: int) -> "Mixture":
        """Reads the mixtures from a network's outputs, [..., M (1 + A)]; means are in [-1, 1]."""
        logits, means = outputs[..., :n_components], outputs[..., n_components:]
        shaped = means.reshape(*means.shape[:-1], n_components, -1)
        return cls(logits.log_softmax(-1), shaped.tanh())

    def surprise(self, actions: Tensor, deviation: float) -> Tensor:
        """Returns -2 sigma^2 / A log p(a), but for a constant, [...].

        Args:
            actions: [..., A].
            deviation: sigma.
        """
        exponents = self.log_weights + _exponents(actions[..., None, :] - self.means, deviation)
        return exponents.logsumexp(-1) * (-2 * deviation**2 / actions.shape[-1])

    def mode(self, deviation: float) -> Tensor:
        """Returns the mean at which the density is largest, [..., A]."""
        between = self.means[..., :, None, :] - self.means[..., None, :, :]  # [..., M, M, A]
        shares = self.log_weights.exp()[..., None, :] * _exponents(between, deviation).exp()
        best = shares.sum(-1).argmax(-1)  # [...]
        index = best[..., None, None].expand(*best.shape, 1, self.means.shape[-1])
        return torch.gather(self.means, -2, index)[..., 0, :]


def _exponents(differences: Tensor, deviation: float) -> Tensor:
    return (differences * differences).sum(-1) * (-0.5 / deviation**2)
