"""RecurrentPolicy, the greedy policy of one seed that remembers the running episode."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.gated_networks import next_memory, read
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows, to_rows
from swarmdata.learn.policies.torch_policy import policy_repr, standard_features
from swarmdata.perception.frames import Frame, in_world
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Float, Int, Step


class RunningMemory:
    """What the robots of E running episodes remember; empty when an episode begins.

    It is kept in float32: the sums of a network round differently when other copies run beside,
    and rounding after every step keeps such differences of 1e-16 from growing along an episode.
    """

    def __init__(self) -> None:
        self._values: Tensor | None = None  # float32 [E, N, M]

    def reset(self, step: Step, copies: Int, size: int) -> None:
        """Empties the memory of copies of a step; of all of them, if their number has changed."""
        shape = (*step.observations.shape[:2], size)
        if self._values is None or self._values.shape != shape:
            self._values = torch.zeros(shape)
        self._values[torch.from_numpy(np.asarray(copies, dtype=np.int64))] = 0.0

    @torch.no_grad()
    def advance(self, gates: Sequence[Layer], features: Tensor, parameters: Parameters) -> Tensor:
        """Takes in normalized features, float64 [E, N, F]; returns the memory after, [E, N, M]."""
        before = by_network(self.before(features)[None], parameters)
        after = next_memory(gates, to_rows(features[None], parameters), before)
        return self.keep(from_rows(after, (1, *features.shape), parameters)[0])

    def before(self, features: Tensor) -> Tensor:
        """Returns the memory before a step of features [E, N, F], float64 [E, N, M]."""
        if self._values is None or self._values.shape[:2] != features.shape[:2]:
            raise SchemaError(
                f"a policy with memory got a step of {tuple(features.shape[:2])} copies and robots,"
                f" and remembers {None if self._values is None else tuple(self._values.shape[:2])}."
                " Call reset(step, copies) with all copies before the first act(step)."
            )
        return self._values.double()

    def keep(self, after: Tensor) -> Tensor:
        """Takes the memory after a step, [E, N, M]; returns it as it is kept, float64."""
        self._values = after.float()
        return self._values.double()


@dataclass(frozen=True, slots=True, eq=False)
class Remembering(ABC):
    """Acting with a memory of gated units, whose layers come first, in one frame.

    `reset` empties the memory of the copies it names, and `act` takes one step in; so every step
    of an episode is acted on once, in order.
    """

    layers: Sequence[Layer]  # gates, then reader, float64; R = 1 if they are shared, else N
    observation_mean: Tensor  # subtracted from observations, float64 [O]
    observation_std: Tensor  # what they are divided by, float64 [O]
    _memory: RunningMemory = field(default_factory=RunningMemory, init=False, repr=False)
    _last: LastMeans[Float] = field(default_factory=LastMeans, init=False, repr=False)

    @abstractmethod
    def local_actions(self, step: Step, features: Tensor, memory: Tensor) -> Tensor:
        """Returns actions in the frame, float64 [E, N, A].

        Features are normalized, [E, N, O], the memory is that after this step, [E, N, M], both
        float64.
        """

    def reset(self, step: Step, copies: Int) -> None:
        self._memory.reset(step, copies, self.layers[1].weight.shape[1])

    @torch.no_grad()
    def act(self, step: Step) -> Float:
        policy: Any = self  # with `frame` and `parameters`
        features = standard_features(self, self.layers[0], step.observations)
        memory = self._memory.advance(self.layers, features, policy.parameters)
        local = self.local_actions(step, features, memory)
        actions = in_world(policy.frame, step.observations, local.numpy()).astype(np.float32)
        self._last.keep(step, actions.copy())  # the caller may write to theirs
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        return certain_log_probs(self._last.require(step), actions)


@dataclass(frozen=True, slots=True, eq=False)
class RecurrentPolicy(Remembering):
    """Actors on all normalized observations of an episode so far, as `TorchPolicy` on the last."""

    squash: bool  # whether the output passes through tanh; otherwise it is clipped to [-1, 1]
    frame: Frame | None = None  # in which the actors see and act; None for the world's
    uses_state: bool = False
    parameters: Parameters = "shared"  # whether the agents share one actor

    __repr__ = policy_repr

    def local_actions(self, step: Step, features: Tensor, memory: Tensor) -> Tensor:
        rows = by_network(memory[None], self.parameters)
        outputs = read(self.layers, to_rows(features[None], self.parameters), rows)
        answers = from_rows(outputs, (1, *features.shape), self.parameters)[0]
        return answers.tanh() if self.squash else answers.clamp(-1, 1)
