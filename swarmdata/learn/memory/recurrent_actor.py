"""The deterministic policies of K seeds that remember, each shared by all agents.

A gated recurrent unit sees a robot's normalized observations and its number; a perceptron maps
these and the memory to actions (Hausknecht & Stone, "Deep recurrent Q-learning for partially
observable MDPs", 2015, have the unit before the last layer). Memories are empty when an episode
begins.
"""

from collections.abc import Sequence

from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.segments import learned, learned_rows, learned_steps
from swarmdata.learn.networks.actor import ACTOR_STREAM, PolicyNetwork, StackedActor
from swarmdata.learn.networks.network_inputs import Standardization
from swarmdata.learn.networks.perceptrons import MLPShape, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.networks.team_networks import by_network, from_rows, to_rows
from swarmdata.types import Batch


class RecurrentActor:
    """Maps all normalized observations of an episode so far, and the agent's number, to actions.

    Outputs pass through tanh (`squash`), or are clipped when acting only.
    """

    def __init__(
        self, setup: Setup, hidden: tuple[int, ...], settings: MemorySettings, *, squash: bool
    ) -> None:
        sizes = setup.sizes
        perceptron = MLPShape(sizes.observation + sizes.n_agents, hidden, sizes.action)
        shape = GatedShape.reading(perceptron, settings.memory_size)
        self.network = StackedGates(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        self.squash, self.window, self.sizes = squash, settings.window, sizes
        self.standard = Standardization.of(setup.statistics, setup.device)

    def transitions(self, batch: Batch) -> Batch:
        """Returns the transitions of windows to learn from, fields [K, R, ...]."""
        return learned_steps(batch, learned_rows(batch.mask, self.window))

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns the transitions to learn from, fields [K, R, ...], and the actions there.

        The batch has windows [K, B, L, ...]; R is B times the steps of a segment.
        """
        features = self.standard(batch.observations)
        steps, seen, memory = learned(self.network, batch, features, self.window, "shared")
        outputs = self.network.read(to_rows(seen, "shared"), by_network(memory, "shared"))
        actions = from_rows(outputs.tanh() if self.squash else outputs, memory.shape, "shared")
        return steps, actions


def make_actor(
    setup: Setup,
    hidden: Sequence[int],
    settings: MemorySettings,
    *,
    squash: bool,
    policy_network: PolicyNetwork,
) -> StackedActor | RecurrentActor:
    """Makes the actors of K seeds, which remember if the settings say so."""
    if settings.has_memory:
        if policy_network != "mlp":
            raise SchemaError(
                f"got policy_network {policy_network} with memory {settings.memory}: only mlp has "
                "a memory. Set memory none or policy_network mlp."
            )
        return RecurrentActor(setup, tuple(hidden), settings, squash=squash)
    return StackedActor(setup, tuple(hidden), squash=squash, policy_network=policy_network)
