"""The greedy policies of one seed over choices: bins, recorded choices, with a memory or none."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.choices.behavior_heads import Rule, behavior_log_probs
from swarmdata.learn.choices.bins import by_dimension, mean_utilities, rows_of, to_actions
from swarmdata.learn.choices.choices import Choices, columns_of
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters, answer
from swarmdata.learn.policies.recurrent_policy import RunningMemory
from swarmdata.learn.policies.torch_policy import Memoryless, policy_repr, standard_features
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Bool, Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False)
class BinPolicy(Memoryless):
    """Takes the best bin of every dimension; computes in float64, as `TorchPolicy` does."""

    layers: Sequence[Layer]
    """Weights of the utility networks, float64, critic after critic; each has one network if robots
    share it, else N."""
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    n_bins: int  # of each dimension, C
    frame: Frame | None = None  # in which the robots see and act; None for the world's
    parameters: Parameters = "shared"  # whether the robots share one network
    n_critics: int = 1  # whose mean utility decides
    uses_state: bool = False

    __repr__ = policy_repr

    def actions(self, observations: Float) -> Float:
        actions = to_actions(self.choices(observations), self.n_bins, torch.float64)
        return in_world(self.frame, observations, actions.numpy()).astype(np.float32)

    def choices(self, observations: Float) -> Tensor:
        """Returns the best choices, whole numbers [E, N, D], for observations [E, N, O]."""
        (first,) = rows_of(self.layers[:1], slice(len(self.layers[0].weight) // self.n_critics))
        return self.best(standard_features(self, first, observations))

    def best(self, features: Tensor) -> Tensor:
        """Returns the best choices, [E, N, D], by what the networks see, float64 [E, N, O]."""
        utilities = mean_utilities(self.layers, features, self.parameters, self.n_critics)
        return by_dimension(utilities, self.n_bins).argmax(-1)


@dataclass(frozen=True, slots=True, eq=False)
class ChoicePolicy(Memoryless):
    """Takes what the rule of its training prefers; computes in float64, as `TorchPolicy` does.

    Of continuous actions it takes bins in [-1, 1]; of recorded choices their numbers as they were
    recorded.
    """

    layers: Sequence[Layer]
    """Weights of the utility networks, float64, critic after critic; each has one network if robots
    share it, else N."""
    behavior: Sequence[Layer]  # weights of the behavior networks; empty without a behavior head
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    choices: Choices  # what there is to choose from
    ranges: tuple[tuple[range, ...], ...]
    """Recorded choices of each robot, by column; empty for bins."""
    rule: Rule  # how utilities and behavior decide
    frame: Frame | None = None  # in which the robots see and act; None for the world's
    parameters: Parameters = "shared"  # whether the robots share one network
    uses_state: bool = False

    __repr__ = policy_repr

    def actions(self, observations: Float) -> Float:
        return self.choose(self._features(observations), observations)

    def act_among(self, step: Step, allowed: Bool) -> Float:
        """Returns the preferred of the recorded choices that the environment allows, [E, N, M].

        Those of a robot's columns come one after the other, then padding.
        """
        return self.choose(self._features(step.observations), step.observations, allowed)

    def utilities(self, features: Tensor) -> Tensor:
        """Returns the networks' mean utilities, float64 [E, N, D, C], of features [E, N, F]."""
        n_rows = 1 if self.parameters == "shared" else features.shape[1]
        n_critics = len(self.layers[0].weight) // n_rows
        outputs = mean_utilities(self.layers, features, self.parameters, n_critics)
        return by_dimension(outputs, self.choices.n_choices)

    @torch.no_grad()
    def choose(self, features: Tensor, observations: Float, allowed: Bool | None = None) -> Float:
        """Returns joint actions, float32 [E, N, D], by what the networks see, float64 [E, N, F].

        Observations are in the world's frame, [E, N, O]; `allowed` is that of
        `act_among`; None: all choices.
        """
        columns = None
        if allowed is not None:
            columns = columns_of(torch.from_numpy(allowed), self.ranges, self.choices.n_columns)
        weights = self.preferred(features, columns)
        actions = self.choices.to_actions(weights).numpy()
        return in_world(self.frame, observations, actions).astype(np.float32)

    def preferred(self, features: Tensor, allowed: Tensor | None = None) -> Tensor:
        """Returns the actions as weights of the choices, float64 [E, N, D, C].

        Features are what the networks see, float64 [E, N, F]; `allowed` is what the environment
        allows, bool [E, N, D, C], None all.
        """
        log_probs = None
        if self.behavior:
            outputs = answer(self.behavior, features, self.parameters)
            log_probs = behavior_log_probs(outputs, self.choices, self.rule.head)
        return self.rule.act(self.utilities(features), log_probs, self.choices, allowed)

    def _features(self, observations: Float) -> Tensor:
        rows = slice(1 if self.parameters == "shared" else observations.shape[1])  # of one critic
        (first,) = rows_of(self.layers[:1], rows)
        return standard_features(self, first, observations)


@dataclass(frozen=True, slots=True, eq=False)
class RecurrentChoicePolicy:
    """Takes what a `ChoicePolicy` prefers that sees a memory of the episode beside the present."""

    gates: Sequence[Layer]
    """Layers of the gated units (`gated_networks`), float64; one unit if robots share it, else
    N."""
    chooser: ChoicePolicy  # sees normalized observations and the memory
    uses_state: bool = False
    _memory: RunningMemory = field(default_factory=RunningMemory, init=False, repr=False)
    _last: LastMeans[Float] = field(default_factory=LastMeans, init=False, repr=False)

    __repr__ = policy_repr

    def reset(self, step: Step, copies: Int) -> None:
        self._memory.reset(step, copies, self.gates[1].weight.shape[1])

    def act(self, step: Step) -> Float:
        return self._act(step, None)

    def act_among(self, step: Step, allowed: Bool) -> Float:
        return self._act(step, allowed)

    def _act(self, step: Step, allowed: Bool | None) -> Float:
        chooser, observations = self.chooser, step.observations
        features = standard_features(chooser, self.gates[0], observations)
        memory = self._memory.advance(self.gates, features, chooser.parameters)
        actions = chooser.choose(torch.cat([features, memory], -1), observations, allowed)
        self._last.keep(step, actions.copy())  # the caller may write to theirs
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        return certain_log_probs(self._last.require(step), actions)
