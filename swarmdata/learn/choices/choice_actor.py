"""Categorical policies of K seeds over recorded choices, with a memory and without.

Robot i draws each column of its action by itself, from the softmax of a network's outputs z:

    log pi(a_i | o_i) = sum_d log softmax(z_d(o_i))[a_id]

The networks are those of continuous actors, with D C outputs for D columns of C choices.
"""

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.choices.behavior_heads import behavior_log_probs, cross_entropy
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.recurrent_actor import make_actor
from swarmdata.learn.networks.actor import PolicyNetwork
from swarmdata.learn.networks.setup import Setup
from swarmdata.types import Batch


class ChoiceActor:
    """Maps normalized observations, and the agent's number, to distributions over choices.

    Critics see actions as `encode` gives them, of `encoded_sizes`.
    """

    def __init__(
        self,
        setup: Setup,
        hidden: Sequence[int],
        settings: MemorySettings,
        *,
        policy_network: PolicyNetwork,
    ) -> None:
        if policy_network != "mlp":
            raise SchemaError(
                f"got policy_network {policy_network} for recorded choices, expected mlp: networks "
                "over sets read the named features of this library's worlds. Set policy_network mlp"
            )
        self.sizes = setup.sizes
        self.choices = Choices.recorded(setup.sizes.choices, setup.sizes.action, setup.device)
        n_outputs = self.choices.n_columns * self.choices.n_choices
        self.encoded_sizes = replace(setup.sizes, action=n_outputs)
        self.outputs = make_actor(
            replace(setup, sizes=self.encoded_sizes), hidden, settings,
            squash=False, policy_network=policy_network,
        )  # fmt: skip
        self.network, self.transitions = self.outputs.network, self.outputs.transitions

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns the transitions to learn from, and log pi of all choices, [K, B, N, D, C].

        A batch is of transitions, [K, B, ...], or with a memory of windows, [K, B, L, ...].
        """
        steps, outputs = self.outputs.along(batch)
        return steps, behavior_log_probs(outputs, self.choices, "factored")

    def surprise(self, log_probs: Tensor, actions: Tensor) -> Tensor:
        """Returns -log pi(a_i | o_i), in nats, [K, B, N], of actions as recorded, [K, B, N, D]."""
        return cross_entropy(log_probs, self.choices.weights(actions), "factored")

    def encode(self, actions: Tensor) -> Tensor:
        """Returns recorded actions as critics see them: 1 for what was chosen, [K, B, N, D C]."""
        return self.choices.weights(actions).flatten(-2)
