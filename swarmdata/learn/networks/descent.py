"""Networks that descend one loss together, and target copies that follow them."""

from collections.abc import Collection, Mapping
from typing import Any

from torch import Tensor

from swarmdata.learn.networks.optimizer import StackedAdam, restore_networks, state_of_networks
from swarmdata.learn.networks.perceptrons import backward
from swarmdata.learn.objectives.td_targets import move_target


class Descent:
    """Adam on several kinds of networks, whose gradients come from one backward pass.

    Args:
        networks: `StackedLayers` of any kinds, by name; the rows of each are grouped by seed.
        n_seeds: number of groups, K.
        learning_rate: Adam's alpha.
        max_norm: largest norm of one seed's gradient in one kind of network; None does not clip.
        followed: names of those that have a target copy.
    """

    def __init__(
        self,
        networks: Mapping[str, Any],
        n_seeds: int,
        learning_rate: float,
        max_norm: float | None,
        followed: Collection[str],
    ) -> None:
        self.networks = dict(networks)
        self.targets = {name: self.networks[name].clone() for name in followed}
        self._adams = {
            name: StackedAdam(network, n_seeds, learning_rate, max_norm)
            for name, network in self.networks.items()
        }

    def step(self, loss: Tensor, scale: float = 1.0) -> None:
        """Descends one step on the sum over seeds of a loss.

        Args:
            loss: one value per seed, [K]; every network has a part in it.
            scale: factor on the learning rate, for schedules.
        """
        backward(loss.sum(), list(self.networks.values()))
        for adam in self._adams.values():
            adam.descend(scale)

    def follow(self, rate: float) -> None:
        """Moves the targets by `rate` of their distance to the networks."""
        for name, target in self.targets.items():
            move_target(target, self.networks[name], rate)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets and Adam's moments, as copies."""
        targets = {f"target_{name}": target.flat.clone() for name, target in self.targets.items()}
        return state_of_networks(self._adams) | targets

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        restore_networks(self._adams, state)
        for name, target in self.targets.items():
            target.load(state[f"target_{name}"])
