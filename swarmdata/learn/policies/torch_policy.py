"""TorchPolicy and SetPolicy, the greedy policies of one seed, and what all without memory share."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.learn.networks.perceptrons import Layer, mlp, present
from swarmdata.learn.networks.set_networks import SetShape, over_sets
from swarmdata.learn.networks.team_networks import Parameters, answer
from swarmdata.perception.feature_slots import Slots, slots_of
from swarmdata.perception.frames import Frame, find_frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import Robot
from swarmdata.types import Float, Int, Step


def policy_repr(policy: Any) -> str:
    """Returns the settings of a policy and the shapes of its tensors, for its `repr`."""
    values = {each.name: getattr(policy, each.name) for each in fields(policy) if each.repr}
    shown = {
        name: tuple(value.shape) if isinstance(value, Tensor) else value
        for name, value in values.items()
        if isinstance(value, (Tensor, str, int, float))
    }
    return f"{type(policy).__name__}({', '.join(f'{name}={shown[name]!r}' for name in shown)})"


@dataclass(frozen=True, slots=True, eq=False)
class StepFunction(ABC):
    """Acting of a policy whose actions are a function of the step, its seeds and times included."""

    _last: LastMeans[Float] = field(default_factory=LastMeans, init=False, repr=False)

    @abstractmethod
    def step_actions(self, step: Step) -> Float:
        """Returns joint actions, float32 [E, N, A]."""

    def reset(self, step: Step, copies: Int) -> None:  # noqa: B027  (there is nothing to forget)
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        """Returns joint actions, float32 [E, N, A]."""
        actions = self.step_actions(step)
        self._last.keep(step, actions.copy())  # the caller may write to theirs
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns 0 for the robots that take the policy's actions, else -infinity, [E, N]."""
        kept = self._last.recall(step)  # right after `act`: the network need not run again
        return certain_log_probs(self.step_actions(step) if kept is None else kept, actions)


@dataclass(frozen=True, slots=True, eq=False)
class Memoryless(StepFunction):
    """Acting of a policy that is one function of observations, without randomness or memory."""

    @abstractmethod
    def actions(self, observations: Float) -> Float:
        """Returns joint actions, float32 [E, N, A], for observations [E, N, O]."""

    def step_actions(self, step: Step) -> Float:
        return self.actions(step.observations)


@dataclass(frozen=True, slots=True, eq=False)
class TorchPolicy(Memoryless):
    """Actors on normalized observations: one for all agents, which sees their number, or one each.

    It computes in float64 on the CPU and rounds once at the end: a product's summation order
    depends on how many copies run together, and in float32 that would show in the actions.
    """

    layers: Sequence[Layer]  # the actors' weights, float64; R = 1 if they are shared, else N
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    squash: bool  # whether the output passes through tanh; otherwise it is clipped to [-1, 1]
    frame: Frame | None = None
    """In which the actors see and act; None for the world's. What it adds to observations is part
    of O."""
    uses_state: bool = False
    parameters: Parameters = "shared"  # whether the agents share one actor
    # by shape [N, O] of observations that were checked, at their first use
    _folded: dict[tuple[int, ...], list[Layer]] = field(
        default_factory=dict, init=False, repr=False
    )

    __repr__ = policy_repr

    def actions(self, observations: Float) -> Float:
        framed = seen_in(self.frame, observations)
        layers = self._folded.get(framed.shape[1:])
        if layers is None:
            mean, std = self.observation_mean, self.observation_std
            check_observations(self.layers[0], framed, mean, self.parameters)
            layers = self._folded[framed.shape[1:]] = fold(self.layers, mean, std, self.parameters)
        outputs = mlp(layers, torch.from_numpy(framed.astype(np.float64)).transpose(0, 1))
        actions = outputs.tanh_() if self.squash else outputs.clamp_(-1, 1)
        turned = in_world(self.frame, observations, actions.transpose(0, 1).numpy())
        return turned.astype(np.float32)


def fold(layers: Sequence[Layer], mean: Tensor, std: Tensor, parameters: Parameters) -> list[Layer]:
    """Returns one network for each robot, which sees observations as they were recorded.

    Normalization, by a mean and std float64 [O], and, where the robots share a network, the robot's
    number are part of its first layer: W' = W / std and b' = b - mean W'. Outputs agree with those
    of `outputs_of` within rounding. Layers are float64, R = 1 if they are shared, else N.
    """
    first, size = layers[0], len(mean)
    weight = standardize(first.weight[:, :size].transpose(1, 2), torch.zeros_like(mean), std)
    bias = first.bias - (weight @ mean)[:, None]
    if parameters == "shared":
        bias = bias + first.weight[0, size:, None]
    n_agents = len(bias)
    folded = first._replace(weight=weight.transpose(1, 2), bias=bias)
    return [
        Layer(*(part.expand(n_agents, -1, -1) for part in present(layer)))
        for layer in (folded, *layers[1:])
    ]


@torch.no_grad()
def outputs_of(policy: Any, observations: Float, *, beside: Tensor | None = None) -> Tensor:
    """Returns what the networks of a policy answer, float64 [E, N, outputs].

    `beside` is what they see besides observations [E, N, O], float64 [E, N, D].
    """
    n_beside = 0 if beside is None else beside.shape[-1]
    features = standard_features(policy, policy.layers[0], observations, n_beside)
    if beside is not None:
        features = torch.cat([features, beside], -1)
    return answer(policy.layers, features, policy.parameters)


def standard_features(policy: Any, first: Layer, observations: Float, n_beside: int = 0) -> Tensor:
    """Returns observations in a policy's frame, normalized, float64 [E, N, O].

    `first` is the first layer of one seed's networks, with `n_beside` inputs besides them.
    """
    framed = seen_in(policy.frame, observations)
    check_observations(first, framed, policy.observation_mean, policy.parameters, n_beside)
    values = torch.from_numpy(framed.astype(np.float64))
    return standardize(values, policy.observation_mean, policy.observation_std)


def seen_in(frame: Frame | None, observations: Float) -> Float:
    """Returns observations in the robots' frame, [E, N, O]; None: the world's."""
    return observations if frame is None else frame.inputs(observations)


def check_observations(
    first: Layer, framed: Float, mean: Tensor, parameters: Parameters, n_beside: int = 0
) -> None:
    """Raises SchemaError unless observations, in the robots' frame, are those of training."""
    n_rows, n_inputs = first.weight.shape[:2]
    n_agents = n_inputs - n_beside - len(mean) if parameters == "shared" else n_rows
    if framed.shape[1:] != (n_agents, len(mean)):
        raise SchemaError(
            f"policy got observations {framed.shape}, expected {len(mean)} features of {n_agents} "
            "agents. Evaluate it on the task and observation model that it was trained on."
        )


@dataclass(frozen=True, slots=True, eq=False)
class SetPolicy(Memoryless):
    """An actor over sets that all robots share and that sees no robot numbers, in float64."""

    layers: Sequence[Layer]  # the actor's weights (`set_networks`), float64, R = 1
    field_mean: Tensor  # subtracted from what is read, float64 [F], F as in `slots.fields`
    field_std: Tensor  # what it is divided by, float64 [F]
    squash: bool  # whether the output passes through tanh; otherwise it is clipped to [-1, 1]
    slots: Slots  # what the columns of an observation describe
    hidden: tuple[int, ...]  # sizes of the actor's hidden layers
    frame: Frame | None = None  # in which the actor sees and acts; None for the world's
    anchor: str = "world"  # of that frame, as `frames.find_frame` takes it
    uses_state: bool = False

    __repr__ = policy_repr

    @torch.no_grad()
    def actions(self, observations: Float) -> Float:
        framed = seen_in(self.frame, observations)
        if framed.shape[-1] != self.slots.n_columns:
            raise SchemaError(
                f"policy got observations {framed.shape}, expected {self.slots.n_columns} features "
                "of any number of robots. To act with other numbers of slots, use the policy that "
                "`SetPolicy.fitted` returns for them."
            )
        moments = self.slots.normalizing(self.field_mean.numpy(), self.field_std.numpy())
        mean, std = (torch.from_numpy(each) for each in moments)
        features = standardize(torch.from_numpy(framed.astype(np.float64)), mean, std)
        shape = SetShape(self.slots, self.hidden, self.layers[-1].weight.shape[-1])
        outputs = over_sets(shape, self.layers, features.flatten(0, 1)[None])
        actions = (outputs.tanh() if self.squash else outputs.clamp(-1, 1)).numpy()
        local = actions.reshape(*observations.shape[:2], -1)
        return in_world(self.frame, observations, local).astype(np.float32)

    def fitted(self, features: Sequence[Feature], robots: Sequence[Robot]) -> "SetPolicy":
        """Returns the same policy for a team of robots and features with other numbers of slots.

        Raises PolicyFitError if the own features, the kinds of slots or their fields differ, and
        SpecError if the vector that the frame turns with is not observed.
        """
        frame = find_frame(features, self.anchor, robots)
        slots = slots_of(tuple(feature.name for feature in features), frame)
        return replace(self, frame=frame, slots=slots.in_order_of(self.slots))
