"""Adam for stacked networks: one fused call, gradients clipped seed by seed; target copies."""

import math
from collections.abc import Collection, Mapping
from typing import Any

import torch
from torch import Tensor
from torch.optim.adam import adam as adam_step

from swarmdata.learn.networks.perceptrons import StackedLayers, backward, move_target, unpadded


class StackedAdam:
    """Adam (Kingma & Ba 2015) on the one buffer of stacked networks, rows grouped by seed.

    Adam works element by element, so the seeds do not see each other, and rounds all elements alike
    (`StackedLayers.padded`). This calls the function behind `torch.optim.Adam`: an object of that
    class imports torch's graph compiler, which takes seconds. `max_norm` is the largest norm of one
    seed's gradient; None does not clip.
    """

    def __init__(
        self,
        network: StackedLayers,
        n_seeds: int,
        learning_rate: float,
        max_norm: float | None = None,
    ) -> None:
        self.network = network
        self.n_seeds = n_seeds
        self.max_norm = max_norm
        self._learning_rate = learning_rate
        self._state = self._fresh()

    def step(self, loss: Tensor, scale: float = 1.0) -> None:
        """Descends on the sum over seeds of a loss [K], at `scale` times the learning rate."""
        self.network.backward(loss.sum())
        self.descend(scale)

    def descend(self, scale: float = 1.0) -> None:
        """Descends one step along the gradient that the network has; clips it first."""
        if self.max_norm is not None:
            clip_per_seed(self.network.gradient, self.n_seeds, self.max_norm)
        padded, (step, mean, square) = self.network.padded, self._state.values()
        assert padded.grad is not None
        with torch.no_grad():
            adam_step(
                [padded], [padded.grad], [mean], [square], [], [step], fused=True, amsgrad=False,
                beta1=0.9, beta2=0.999, lr=self._learning_rate * scale, weight_decay=0.0, eps=1e-8,
                maximize=False,
            )  # fmt: skip

    def state_dict(self, prefix: str = "") -> dict[str, Tensor]:
        """The moments [R, P] and the number of steps, as copies; `prefix` begins their names."""
        size = self.network.flat.shape
        return {
            prefix + name: (unpadded(value, size) if value.ndim else value).clone()
            for name, value in self._state.items()
        }

    def load_state_dict(self, state: Mapping[str, Tensor], prefix: str = "") -> None:
        size, fresh = self.network.flat.shape, self._fresh()
        for name, value in fresh.items():
            (unpadded(value, size) if value.ndim else value).copy_(state[prefix + name])
        self._state = fresh

    def _fresh(self) -> dict[str, Tensor]:
        padded = self.network.padded
        return {
            "step": torch.zeros((), device=padded.device),
            "exp_avg": torch.zeros_like(padded),
            "exp_avg_sq": torch.zeros_like(padded),
        }


def clip_per_seed(gradient: Tensor, n_seeds: int, max_norm: float) -> Tensor:
    """Scales gradients [R, P], rows grouped by seed, to `max_norm` at most; returns norms, [K]."""
    grouped = gradient.view(n_seeds, -1)
    norms: Tensor = torch.linalg.vector_norm(grouped, dim=1)
    grouped.mul_((max_norm / (norms + 1e-6)).clamp(max=1.0)[:, None])
    return norms


def linear(progress: float, floor: float = 0.0) -> float:
    """Returns the factor of a linear decay from 1 to `floor`, at a progress of 0 to 1 or more."""
    return 1 + (floor - 1) * min(progress, 1.0)


def cosine(update: int, n_updates: int, floor: float = 0.0) -> float:
    """Returns the factor of a cosine decay (Loshchilov & Hutter 2017, eq. 5, without restarts).

    It is that after `update` of `n_updates` updates, and stays at `floor` beyond.
    """
    progress = min(update / n_updates, 1.0)
    return floor + (1 - floor) * 0.5 * (1 + math.cos(math.pi * progress))


class Descent:
    """Adam on several kinds of networks of K seeds, and target copies that follow some of them.

    `networks` are `StackedLayers`, by name; rows are grouped by seed. `learning_rate` is Adam's
    alpha, of all or by name, `max_norm` the largest norm of one seed's gradient in one kind of
    network, None does not clip; those that are `followed` have target copies. In checkpoints,
    Adam's moments begin with the names in `moments`, or with NAME_adam.
    """

    def __init__(
        self,
        networks: Mapping[str, Any],
        n_seeds: int,
        learning_rate: float | Mapping[str, float],
        max_norm: float | None,
        followed: Collection[str] = (),
        moments: Mapping[str, str] | None = None,
    ) -> None:
        self._moments = moments or {}
        self.networks = dict(networks)
        self.targets = {name: self.networks[name].clone() for name in followed}
        rates = learning_rate
        self._adams = {
            name: StackedAdam(
                network, n_seeds, rates[name] if isinstance(rates, Mapping) else rates, max_norm
            )
            for name, network in self.networks.items()
        }

    def step(self, loss: Tensor, scale: float = 1.0) -> None:
        """Descends on the sum over seeds of a loss [K] in which every network has a part."""
        self.backward(loss)
        self.descend(scale)

    def step_of(self, name: str, loss: Tensor, scale: float = 1.0) -> None:
        """Descends one step with one kind of network; arguments as of `step`."""
        self._adams[name].step(loss, scale)

    def backward(self, loss: Tensor) -> None:
        """Fills the gradients of all networks with that of the sum over seeds of a loss [K]."""
        backward(loss.sum(), list(self.networks.values()))

    def descend(self, scale: float = 1.0) -> None:
        for adam in self._adams.values():
            adam.descend(scale)

    def follow(self, rate: float) -> None:
        """Moves the targets by `rate` of their distance to the networks (Polyak averaging)."""
        for name, target in self.targets.items():
            move_target(target, self.networks[name], rate)

    def state_dict(self) -> dict[str, Tensor]:
        state = {name: network.flat.clone() for name, network in self.networks.items()}
        for name, target in self.targets.items():
            state[f"target_{name}"] = target.flat.clone()
        for name, adam in self._adams.items():
            state |= adam.state_dict(self._prefix(name))
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        for name, adam in self._adams.items():
            adam.network.load(state[name])
            adam.load_state_dict(state, self._prefix(name))
        for name, target in self.targets.items():
            target.load(state[f"target_{name}"])

    def _prefix(self, name: str) -> str:
        return self._moments.get(name, f"{name}_adam") + "."
