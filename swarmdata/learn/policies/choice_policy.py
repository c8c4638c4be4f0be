"""ChoicePolicy, the greedy policy of one seed that learned choices offline."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.choices.behavior_heads import Rule, behavior_log_probs
from swarmdata.learn.choices.bins import by_dimension, mean_utilities
from swarmdata.learn.choices.choices import Choices, columns_of
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.torch_policy import Memoryless, outputs_of
from swarmdata.perception.frames import Frame, in_world
from swarmdata.types import Bool, Float, Step


@dataclass(frozen=True, slots=True, eq=False)
class ChoicePolicy(Memoryless):
    """Takes what the rule of its training prefers; computes in float64, as `TorchPolicy` does.

    Of continuous actions it takes bins in [-1, 1]; of recorded choices their numbers as they were
    recorded.

    Attributes:
        layers: weights of the utility networks, float64, critic after critic; each has one network
            if robots share it, else N.
        behavior: weights of the behavior networks; empty without a behavior head.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        choices: what there is to choose from.
        ranges: recorded choices of each robot, by column; empty for bins.
        rule: how utilities and behavior decide.
        frame: in which the robots see and act; None for the world's.
        parameters: whether the robots share one network.
    """

    layers: Sequence[Layer]
    behavior: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    choices: Choices
    ranges: tuple[tuple[range, ...], ...]
    rule: Rule
    frame: Frame | None = None
    parameters: Parameters = "shared"
    uses_state: bool = False

    def actions(self, observations: Float) -> Float:
        """Returns joint actions, float32 [E, N, D], for observations [E, N, O].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        return self._choose(observations, None)

    def act_among(self, step: Step, allowed: Bool) -> Float:
        """Returns the preferred of the allowed choices, as `act` does of all.

        Args:
            step: what the robots see.
            allowed: recorded choices that the environment allows: all columns of a robot one after
                the other, then padding, [E, N, M].
        """
        columns = columns_of(torch.from_numpy(allowed), self.ranges, self.choices.n_columns)
        return self._choose(step.observations, columns)

    def utilities(self, observations: Float) -> Tensor:
        """Returns the mean utilities of both networks, float64 [E, N, D, C].

        Args:
            observations: in the robots' frame, [E, N, O].
        """
        n_rows = 1 if self.parameters == "shared" else observations.shape[1]
        moments, n_critics = (
            (self.observation_mean, self.observation_std),
            len(self.layers[0].weight) // n_rows,
        )
        outputs = mean_utilities(self.layers, observations, moments, self.parameters, n_critics)
        return by_dimension(outputs, self.choices.n_choices)

    def _choose(self, observations: Float, allowed: Tensor | None) -> Float:
        framed = observations if self.frame is None else self.frame.inputs(observations)
        log_probs = None
        if self.behavior:
            outputs = self._answer(self.behavior, framed)
            log_probs = behavior_log_probs(outputs, self.choices, self.rule.head)
        utilities = self.utilities(framed)
        weights = self.rule.act(utilities, log_probs, self.choices, allowed)
        actions = self.choices.to_actions(weights).numpy()
        return in_world(self.frame, observations, actions).astype(np.float32)

    def _answer(self, layers: Sequence[Layer], observations: Float) -> Tensor:
        mean, std = self.observation_mean, self.observation_std
        return outputs_of(layers, observations, mean, std, self.parameters)
