"""RecurrentFlowPolicy, a `FlowPolicy` whose robots remember the running episode."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import answer
from swarmdata.learn.policies.flow_policy import Noise, Redraw, drawn_noise, known_noise
from swarmdata.learn.policies.recurrent_policy import RunningMemory
from swarmdata.learn.policies.torch_policy import standard_features
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Double, Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecurrentFlowPolicy:
    """Robots turn noise into actions, given all normalized observations of an episode so far.

    `reset` empties the memory of the copies it names, and `act` takes one step in; so every step
    of an episode is acted on once, in order. The noise is that of a `FlowPolicy`.

    Attributes:
        layers: gates and reader of the actors (`gated_networks`), float64, R = 1.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        n_agents: N, the robots it was trained for.
        noise: what a robot knows of the team's noise.
        redraw: when noise is drawn anew.
        noise_scale: factor on the noise when acting.
        frame: in which the actors see and act; None for the world's.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    n_agents: int
    noise: Noise
    redraw: Redraw
    noise_scale: float = 1.0
    frame: Frame | None = None
    uses_state: bool = False
    _memory: RunningMemory = field(default_factory=RunningMemory, init=False, repr=False)
    _last: LastMeans = field(default_factory=LastMeans, init=False, repr=False)

    def draw(self, step: Step) -> Double:
        """Returns the noise of all robots, normal of deviation `noise_scale`, [E, N, A]."""
        size = self.layers[-1].weight.shape[-1]
        return self.noise_scale * drawn_noise(step, self.n_agents, size, self.redraw)

    def reset(self, step: Step, copies: Int) -> None:
        self._memory.reset(step, copies, self.layers[1].weight.shape[1])

    @torch.no_grad()
    def act(self, step: Step) -> Float:
        """Returns joint actions, float32 [E, N, A], and remembers the step.

        Raises:
            SchemaError: the observations are not those the policy was trained on, or `reset` was
                not called with these copies.
        """
        observations = step.observations
        framed = observations if self.frame is None else self.frame.inputs(observations)
        features = standard_features(
            self.layers[0], framed, self.observation_mean, self.observation_std, "shared"
        )
        memory = self._memory.advance(self.layers, features, "shared")
        noise = known_noise(torch.from_numpy(self.draw(step)), self.noise)
        known = torch.cat([features, memory, noise], -1)
        outputs = answer(self.layers[N_GATE_LAYERS:], known, "shared")
        actions = in_world(self.frame, observations, outputs.tanh().numpy()).astype(np.float32)
        self._last.keep(step, actions.astype(np.float64))
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        return certain_log_probs(self._last.require(step).astype(np.float32), actions)
