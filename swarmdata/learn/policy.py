"""TorchPolicy, the greedy policy of one seed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.inputs import standardize, with_agent_id
from swarmdata.learn.networks import Layer, mlp
from swarmdata.types import Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False)
class TorchPolicy:
    """One actor, shared by all agents, on normalized observations and the agent's number.

    It computes in float64 on the CPU and rounds once at the end: a product's summation order
    depends on how many copies run together, and in float32 that would show in the actions.

    Attributes:
        layers: the actor's weights, R = 1, float64.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        squash: whether the output passes through tanh; otherwise it is clipped to [-1, 1].
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    squash: bool
    uses_state: bool = False

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        return self.actions(step.observations)

    def actions(self, observations: Float) -> Float:
        """Returns the actor's actions, float32 [E, N, A], for observations [E, N, O].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        n_copies, n_agents, size = observations.shape
        expected = len(self.observation_mean)
        if size != expected or size + n_agents != self.layers[0].weight.shape[1]:
            raise SchemaError(
                f"policy got observations {observations.shape}, expected {expected} features "
                f"of {self.layers[0].weight.shape[1] - expected} agents. "
                "Evaluate it on the task and observation model that it was trained on."
            )
        with torch.no_grad():
            exact = torch.from_numpy(observations.astype(np.float64))
            inputs = standardize(exact, self.observation_mean, self.observation_std)
            outputs = mlp(self.layers, with_agent_id(inputs).view(1, n_copies * n_agents, -1))
            actions = outputs.tanh() if self.squash else outputs.clamp(-1, 1)
        result: Float = actions.view(n_copies, n_agents, -1).numpy().astype(np.float32)
        return result
