"""PPO's clipped objective for Gaussian actions of a given standard deviation."""

import numpy as np
import torch
from torch import Tensor


def clipped_losses(
    means: Tensor,
    actions: Tensor,
    old_log_probs: Tensor,
    advantages: Tensor,
    *,
    std: float,
    clip: float,
) -> tuple[Tensor, Tensor]:
    """Returns the negative clipped objective of each sample, and its divergence, two [R, B].

    Schulman et al. 2017, equation 7. The divergence estimates KL(old, new) by r - 1 - log r of the
    ratio r, which is never negative (Schulman, "Approximating KL divergence", 2020); no gradient.

    Args:
        means: of the present policies, [R, B, A].
        actions: taken, [R, B, A].
        old_log_probs: of them under the policies that took them, up to the constant
            A log(2 pi) / 2, which cancels, [R, B].
        advantages: normalized, [R, B].
        std: standard deviation of actions.
        clip: how far a ratio may leave 1 before it is worth no more.
    """
    z = (actions - means) / std
    log_ratio = (-0.5 * z * z - np.log(std)).sum(-1) - old_log_probs
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1 - clip, 1 + clip)
    losses = -torch.minimum(ratio * advantages, clipped * advantages)
    return losses, (ratio - 1 - log_ratio).detach()
