"""The policies of one seed that trained networks of K seeds give, as copies of their parameters."""

from collections.abc import Sequence

import torch

from swarmdata.learn.choices.behavior_heads import Rule
from swarmdata.learn.choices.choice_actor import ChoiceActor
from swarmdata.learn.choices.utility_networks import N_CRITICS, UtilityNetworks
from swarmdata.learn.flows.one_step_actor import OneStepActor
from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS
from swarmdata.learn.memory.recurrent_actor import RecurrentActor
from swarmdata.learn.networks.actor import StackedActor
from swarmdata.learn.networks.perceptrons import Layer, StackedMLP
from swarmdata.learn.networks.set_networks import StackedSets
from swarmdata.learn.policies.choice_policy import ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.policies.drawn_policy import FlowPolicy, RecurrentFlowPolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy

GREEDY = Rule("none", temperature=1.0, threshold=0.0, head="factored")
"""Takes the likeliest choice of each column; the numbers have no effect."""

ActorPolicy = TorchPolicy | SetPolicy | RecurrentPolicy | ChoicePolicy | RecurrentChoicePolicy


def actor_policy(actor: StackedActor, index: int) -> TorchPolicy | SetPolicy:
    """The policy of seed number `index` of actors without a memory, as it is now."""
    layers, frame = actor.network.extract(index, torch.float64), actor.sizes.frame
    if not isinstance(actor.network, StackedSets):
        return TorchPolicy(
            layers=layers,
            observation_mean=actor.standard.mean,
            observation_std=actor.standard.std,
            squash=actor.squash,
            frame=frame,
        )
    mean, std = actor.field_moments
    return SetPolicy(
        layers=layers,
        field_mean=torch.from_numpy(mean),
        field_std=torch.from_numpy(std),
        squash=actor.squash,
        slots=actor.network.shape.slots,
        hidden=actor.network.shape.hidden,
        frame=frame,
        anchor="world" if frame is None else frame.anchor_of(actor.sizes.features),
    )


def policy_of(actor: StackedActor | RecurrentActor | ChoiceActor, index: int) -> ActorPolicy:
    """The policy of seed number `index` of actors of any kind, as it is now."""
    if isinstance(actor, StackedActor):
        return actor_policy(actor, index)
    if isinstance(actor, ChoiceActor):
        return _likeliest(actor, index)
    return RecurrentPolicy(
        layers=actor.network.extract(index, torch.float64),
        observation_mean=actor.standard.mean,
        observation_std=actor.standard.std,
        squash=actor.squash,
        frame=actor.sizes.frame,
    )


def flow_policy(actor: OneStepActor, index: int) -> FlowPolicy | RecurrentFlowPolicy:
    """The policy of seed number `index` of students of a flow, as it is now."""
    kind = FlowPolicy if isinstance(actor.network, StackedMLP) else RecurrentFlowPolicy
    return kind(
        layers=actor.network.extract(index, torch.float64),
        observation_mean=actor.standard.mean,
        observation_std=actor.standard.std,
        n_agents=actor.sizes.n_agents,
        noise=actor.config.noise,
        redraw=actor.config.redraw,
        noise_scale=actor.config.noise_scale,
        frame=actor.sizes.frame,
    )


def utility_policy(networks: UtilityNetworks, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
    """The greedy policy of seed number `index` of utility networks, as it is now."""
    behavior, standard = networks.behavior, networks.normalizer.observations
    chooser = ChoicePolicy(
        layers=networks.team.extract(index, N_CRITICS),
        behavior=[] if behavior is None else behavior.extract(index),
        observation_mean=standard.mean,
        observation_std=standard.std,
        choices=networks.choices.to_cpu(),
        ranges=networks.sizes.choices,
        rule=networks.rule,
        frame=networks.sizes.frame,
        parameters=networks.config.parameters,
    )
    if networks.memory is None:
        return chooser
    return RecurrentChoicePolicy(networks.memory.extract(index), chooser)


def _likeliest(actor: ChoiceActor, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
    outputs = policy_of(actor.outputs, index)
    assert isinstance(outputs, TorchPolicy | RecurrentPolicy)  # sets are refused for choices
    has_memory = isinstance(outputs, RecurrentPolicy)
    n_features = len(outputs.observation_mean)
    chooser = ChoicePolicy(
        layers=_reader(outputs.layers, n_features) if has_memory else outputs.layers,
        behavior=[],
        observation_mean=outputs.observation_mean,
        observation_std=outputs.observation_std,
        choices=actor.choices.to_cpu(),
        ranges=actor.sizes.choices,
        rule=GREEDY,
        frame=actor.sizes.frame,
    )
    if not has_memory:
        return chooser
    return RecurrentChoicePolicy(outputs.layers[:N_GATE_LAYERS], chooser)


def _reader(layers: Sequence[Layer], n_features: int) -> list[Layer]:
    """Returns the reader of a recurrent actor with the agent's number as its last inputs.

    Recurrent actors read observations, number, memory; policies over choices observations, memory,
    number.
    """
    first, *others = layers[N_GATE_LAYERS:]
    n_memory = layers[1].weight.shape[1]
    weight, n_seen = first.weight, first.weight.shape[1] - n_memory
    features, number = weight[:, :n_features], weight[:, n_features:n_seen]
    memory = weight[:, n_seen:]
    return [first._replace(weight=torch.cat([features, memory, number], 1)), *others]
