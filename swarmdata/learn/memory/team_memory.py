"""TeamMemory: what the robots of K seeds remember, for networks that see it beside the present."""

from collections.abc import Callable

import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.segments import (
    learned_rows,
    learned_steps,
    remembered,
    remembered_next,
    take,
)
from swarmdata.learn.networks.perceptrons import Layer, initialize
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


class TeamMemory:
    """Gated units of K seeds: one that all robots of a seed share, or one for each robot.

    Args:
        setup: sizes and seeds.
        settings: of the memory.
        stream: separates the draws of different networks of one seed.
        parameters: whether robots share one unit, which sees their number.
    """

    def __init__(
        self, setup: Setup, settings: MemorySettings, stream: int, parameters: Parameters
    ) -> None:
        is_shared, n_agents = parameters == "shared", setup.sizes.n_agents
        self.parameters, self.window = parameters, settings.window
        self.n_rows = 1 if is_shared else n_agents  # networks of one seed
        n_inputs = setup.sizes.observation + (n_agents if is_shared else 0)
        shape = GatedShape(n_inputs, settings.memory_size)
        self.network = StackedGates(shape, setup.n_seeds * self.n_rows, setup.device)
        initialize(self.network, setup.seeds, stream)

    def along(
        self, batch: Batch, normalize: Callable[[Tensor], Tensor], slow: StackedGates
    ) -> tuple[Batch, Tensor, Tensor, Tensor]:
        """Returns transitions to learn from, and normalized observations with memories.

        Args:
            batch: windows [K, B, L, ...].
            normalize: makes observations as recorded comparable.
            slow: target copies of the units.

        Returns:
            Transitions, fields [K, R, ...]; what is seen, [K, R, N, O + M]; what is seen one step
            later, and what the target copies see then, both without a gradient.
        """
        rows = learned_rows(batch.mask, self.window)
        steps, features = learned_steps(batch, rows), normalize(batch.observations)
        memory = take(remembered(self.network, features, batch.mask, self.parameters), rows)
        seen = torch.cat([take(features, rows), memory], -1)
        with torch.no_grad():
            after = normalize(steps.next_observations)
            kept = take(remembered(slow, features, batch.mask, self.parameters), rows)
            later, slow_later = (
                torch.cat([after, remembered_next(network, after, now, self.parameters)], -1)
                for network, now in ((self.network, memory), (slow, kept))
            )
        return steps, seen, later, slow_later

    def extract(self, index: int) -> list[Layer]:
        """Returns a copy of the units of seed number `index`, float64, on the CPU."""
        return self.network.extract(index * self.n_rows, torch.float64, self.n_rows)
