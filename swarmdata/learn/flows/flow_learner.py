"""The methods that algorithms share which distill a joint flow: their policies and their state.

An algorithm takes these functions as its methods:

    policy, state_dict, load_state_dict = policy_of, state_of, restore_state
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch

from swarmdata.learn.flows.distillation import Distillation
from swarmdata.learn.networks.network_inputs import generator_states, restore_generators
from swarmdata.learn.policies.flow_policy import FlowPolicy
from swarmdata.learn.policies.recurrent_flow_policy import RecurrentFlowPolicy


class Learned(Protocol):
    """Something with parameters, and optimizers of them."""

    def state_dict(self) -> dict[str, Any]: ...
    def load_state_dict(self, state: Mapping[str, Any]) -> None: ...


class FlowLearner(Protocol):
    """K seeds of an algorithm with a flow and the actors that copy it."""

    copy: Distillation
    generators: list[torch.Generator]
    n_updates: int

    @property
    def learned(self) -> Sequence[Learned]:
        """All that has parameters; entries of their states have different names."""
        ...


def policy_of(self: FlowLearner, index: int) -> FlowPolicy | RecurrentFlowPolicy:
    """The policy of seed number `index`, as it is now."""
    return self.copy.actor.policy(index)


def state_of(self: FlowLearner) -> dict[str, Any]:
    """Parameters, Adam's moments, generators and the number of updates, as copies."""
    state = {
        "n_updates": torch.tensor(self.n_updates),
        "generators": generator_states(self.generators),
    }
    for part in self.learned:
        state |= part.state_dict()
    return state


def restore_state(self: FlowLearner, state: Mapping[str, Any]) -> None:
    """Restores what `state_dict` returned."""
    self.n_updates = int(state["n_updates"])
    restore_generators(self.generators, state["generators"])
    for part in self.learned:
        part.load_state_dict(state)
