"""Losses of trained policies and critics on data that they were not trained on."""

from typing import Protocol, runtime_checkable

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.evaluation.fqe import Answered
from swarmdata.learn.training.training_data import Data
from swarmdata.types import Batch, Double

N_BATCHES, BATCH_SIZE = 32, 256
"""Held-out transitions on which a TD error is measured."""


@runtime_checkable
class HasTDError(Protocol):
    """An algorithm with critics that can be measured on data; the others have no such error."""

    def td_error(self, batch: Batch) -> Tensor:
        """Returns the mean over critics and rows of (Q - y)^2 in scaled rewards, [K]."""
        ...


def imitation_error(split: Answered) -> Double:
    """Returns what behavior cloning minimizes: mean |pi(o_i) - a_i|^2 / A, [K]."""
    return _mean(_errors(split), torch.ones_like(split.data.returns, dtype=torch.float64))


def weighted_imitation_error(split: Answered) -> Double:
    """Returns the imitation error with more weight on what went well, [K].

    The weight of a step is exp((G - mean G) / std G) with its return-to-go G, the weight of
    exponentially weighted imitation (Wang et al. 2018, "Exponentially Weighted Imitation Learning
    for Batched Historical Data", eq. 4, beta = 1) with the mean in place of a value function.
    """
    returns = split.data.returns.double()
    spread = returns.std(correction=0)
    weights = torch.exp((returns - returns.mean()) / torch.where(spread > 0, spread, 1.0))
    return _mean(_errors(split), weights)


def _errors(split: Answered) -> Tensor:
    """Squared errors of the policies' actions, mean over robots and components, [K, n]."""
    data = split.data
    return (split.answers[:, data.rows] - data.actions).square().mean((2, 3)).double()


def _mean(errors: Tensor, weights: Tensor) -> Double:
    result: Double = ((errors * weights).sum(1) / weights.sum()).cpu().numpy()
    return result


@torch.no_grad()
def td_errors(
    algorithm: object, dataset: Data, n_seeds: int, scale: float, device: torch.device | str
) -> Double | None:
    """Returns the root mean square of Q - y of an algorithm's own critics, [K], if it has any.

    In units of rewards, but still of the algorithm's own discount and target: comparable between
    seeds and settings of one algorithm at best.

    Args:
        algorithm: trained; noise in its targets is drawn from its generators.
        dataset: what to measure on, usually the validation split.
        n_seeds: policies of the algorithm, K.
        scale: what the algorithm divides rewards by.
        device: where the algorithm is.
    """
    if not isinstance(algorithm, HasTDError):
        return None
    sampler = dataset.sampler(BATCH_SIZE, seed=0)
    total = np.zeros(n_seeds)
    for _ in range(N_BATCHES):
        index = np.broadcast_to(sampler.draw(), (n_seeds, BATCH_SIZE))
        total += algorithm.td_error(sampler.gather(index).to_torch(device)).cpu().numpy()
    return scale * np.sqrt(total / N_BATCHES)
