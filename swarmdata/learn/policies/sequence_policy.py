"""SequencePolicy, the greedy policy of one seed whose robots decide one after another."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.memory.sequence_networks import (
    EMBED,
    HEAD,
    Mixture,
    decide,
    memory_size,
    over_step,
    told_actions,
    with_past,
)
from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.recurrent_policy import RunningMemory
from swarmdata.learn.policies.torch_policy import policy_repr, seen_in, standard_features
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False)
class SequencePolicy:
    """Each robot takes the likeliest mode of its action, given those of the robots before it.

    The team acts jointly: in every step robot i needs to hear from all robots before it, what they
    have just chosen and what they made of their past. Robots cannot act by it alone, unless it was
    trained so (`joint`).

    It computes in float64 on the CPU and rounds once at the end; the memory, as `RunningMemory`.
    """

    parameters: ClassVar[Parameters] = "shared"

    layers: Sequence[Layer]  # of a sequence network (`sequence_networks`), float64, R = 1
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    n_heads: int  # of its attentions
    n_components: int  # of the mixtures
    deviation: float  # of each component
    joint: bool = True  # whether robots hear those before them
    frame: Frame | None = None  # in which the actors see and act; None for the world's
    uses_state: bool = False
    _memory: RunningMemory = field(default_factory=RunningMemory, init=False, repr=False)
    _last: LastMeans[Float] = field(default_factory=LastMeans, init=False, repr=False)

    __repr__ = policy_repr

    def reset(self, step: Step, copies: Int) -> None:
        width = self.layers[HEAD].weight.shape[1]
        self._memory.reset(step, copies, memory_size(width, self.n_heads))

    @torch.no_grad()
    def act(self, step: Step) -> Float:
        observations = step.observations
        features = standard_features(self, self.layers[EMBED], observations)
        before = self._memory.before(features)[None]
        embedded, recalled, after = over_step(
            self.layers, with_agent_id(features)[None], before, self.n_heads
        )
        self._memory.keep(after[0])
        tokens = with_past(self.layers, embedded, recalled)
        framed = torch.from_numpy(seen_in(self.frame, observations).astype(np.float64))
        local = self._in_order(tokens, framed[None])[0]
        actions = in_world(self.frame, observations, local.numpy()).astype(np.float32)
        self._last.keep(step, actions.copy())  # the caller may write to theirs
        return actions

    def _in_order(self, tokens: Tensor, framed: Tensor) -> Tensor:
        """Returns actions in the frame, [1, E, N, A], of tokens [1, E, N, width]."""
        n_agents = tokens.shape[2]
        size = self.layers[HEAD].weight.shape[2] // self.n_components - 1
        chosen = tokens.new_zeros(*tokens.shape[:3], size)
        for robot in range(n_agents):
            team = slice(robot + 1)
            told = told_actions(self.frame, framed[:, :, team], chosen[:, :, team])[:, :, -1:]
            hears = (torch.arange(robot + 1) < robot)[None] & self.joint
            outputs = decide(self.layers, tokens[:, :, team], told, hears, self.n_heads)
            mixture = Mixture.of(outputs, self.n_components)
            chosen[:, :, robot] = mixture.mode(self.deviation)[:, :, 0]
        return chosen

    def log_probs(self, step: Step, actions: Float) -> Float:
        return certain_log_probs(self._last.require(step), actions)
