"""Categorical policies of K seeds over recorded choices, with a memory and without.

Robot i draws each column of its action by itself, from the softmax of a network's outputs z:

    log pi(a_i | o_i) = sum_d log softmax(z_d(o_i))[a_id]

The networks are those of continuous actors, with D C outputs for D columns of C choices.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.choices.behavior_heads import Rule, behavior_log_probs, cross_entropy
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.recurrent_actor import make_actor
from swarmdata.learn.networks.actor import PolicyNetwork
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.policies.choice_policy import ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch

GREEDY = Rule("none", temperature=1.0, threshold=0.0, head="factored")
"""Takes the likeliest choice of each column; the numbers have no effect."""


class ChoiceActor:
    """Maps normalized observations, and the agent's number, to distributions over choices.

    Attributes:
        network: of K seeds.
        encoded_sizes: the dataset's, with actions as `encode` gives them.

    Args:
        setup: sizes, seeds and the dataset's statistics.
        hidden: sizes of the hidden layers.
        settings: of the memory.
        policy_network: only `mlp`.

    Raises:
        SchemaError: another network, which reads the named features of continuous worlds.
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
        self._ranges, self._frame = setup.sizes.choices, setup.sizes.frame
        self._choices = Choices.recorded(self._ranges, setup.sizes.action, setup.device)
        n_outputs = self._choices.n_columns * self._choices.n_choices
        self.encoded_sizes = replace(setup.sizes, action=n_outputs)
        self._outputs = make_actor(
            replace(setup, sizes=self.encoded_sizes), hidden, settings,
            squash=False, policy_network=policy_network,
        )  # fmt: skip
        self.network = self._outputs.network

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns the transitions to learn from, and log pi of all choices, [K, B, N, D, C].

        Args:
            batch: transitions, or windows [K, B, L, ...] with a memory.
        """
        steps, outputs = self._outputs.along(batch)
        return steps, behavior_log_probs(outputs, self._choices, "factored")

    def surprise(self, log_probs: Tensor, actions: Tensor) -> Tensor:
        """Returns -log pi(a_i | o_i) of recorded actions, in nats, [K, B, N].

        Args:
            log_probs: from `along`.
            actions: as recorded, [K, B, N, D].
        """
        return cross_entropy(log_probs, self._choices.weights(actions), "factored")

    def encode(self, actions: Tensor) -> Tensor:
        """Returns recorded actions as critics see them: 1 for what was chosen, [K, B, N, D C]."""
        return self._choices.weights(actions).flatten(-2)

    def policy(self, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
        """Returns the policy of seed number `index`, which takes the likeliest choices."""
        actor = self._outputs.policy(index)
        assert not isinstance(actor, SetPolicy)  # refused above
        has_memory = isinstance(actor, RecurrentPolicy)
        n_features = len(actor.observation_mean)
        chooser = ChoicePolicy(
            layers=_reader(actor.layers, n_features) if has_memory else actor.layers,
            behavior=[],
            observation_mean=actor.observation_mean,
            observation_std=actor.observation_std,
            choices=self._choices.to_cpu(),
            ranges=self._ranges,
            rule=GREEDY,
            frame=self._frame,
        )
        return (
            RecurrentChoicePolicy(actor.layers[:N_GATE_LAYERS], chooser) if has_memory else chooser
        )


def _reader(layers: Sequence[Layer], n_features: int) -> list[Layer]:
    """Returns the reader of a recurrent actor with the agent's number as its last inputs.

    Recurrent actors read observations, number, memory; policies over choices observations, memory,
    number.

    Args:
        layers: gates and reader.
        n_features: of an observation.
    """
    first, *others = layers[N_GATE_LAYERS:]
    n_memory = layers[1].weight.shape[1]
    weight, n_seen = first.weight, first.weight.shape[1] - n_memory
    features, number = weight[:, :n_features], weight[:, n_features:n_seen]
    memory = weight[:, n_seen:]
    return [first._replace(weight=torch.cat([features, memory, number], 1)), *others]
