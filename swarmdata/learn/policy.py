"""TorchPolicy, the greedy policy of one seed."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from swarmdata.density import LastMeans, noisy_log_probs
from swarmdata.errors import SchemaError
from swarmdata.frames import Frame
from swarmdata.learn.inputs import standardize, with_agent_id
from swarmdata.learn.networks import Layer, mlp
from swarmdata.types import Float, Int, Step


@dataclass(frozen=True, slots=True, eq=False)
class TorchPolicy:
    """One actor for all agents, or one each, on normalized observations and the agent's number.

    It computes in float64 on the CPU and rounds once at the end: a product's summation order
    depends on how many copies run together, and in float32 that would show in the actions.

    Attributes:
        layers: the actors' weights, float64; R = 1 if agents share them, else N.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        squash: whether the output passes through tanh; otherwise it is clipped to [-1, 1].
        frame: in which the actor sees and acts; None for the world's.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    squash: bool
    frame: Frame | None = None
    uses_state: bool = False
    _last: LastMeans = field(default_factory=LastMeans, init=False, repr=False)

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        actions = self.actions(step.observations)
        self._last.keep(step, actions.astype(np.float64))
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        means = self._last.recall(step)  # right after `act`: the network need not run again
        if means is None:
            means = self.actions(step.observations).astype(np.float64)
        return noisy_log_probs(means, actions, 0.0)

    def actions(self, observations: Float) -> Float:
        """Returns the actor's actions, float32 [E, N, A], for observations [E, N, O].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        seen = observations if self.frame is None else self.frame.seen(observations)
        n_copies, n_agents, size = seen.shape
        expected = len(self.observation_mean)
        n_rows, n_inputs = self.layers[0].weight.shape[:2]
        if size != expected or size + n_agents != n_inputs:
            raise SchemaError(
                f"policy got observations {observations.shape}, expected "
                f"{expected - size + observations.shape[2]} features of {n_inputs - expected} "
                "agents. Evaluate it on the task and observation model that it was trained on."
            )
        with torch.no_grad():
            exact = torch.from_numpy(seen.astype(np.float64))
            inputs = with_agent_id(standardize(exact, self.observation_mean, self.observation_std))
            rows = inputs.view(n_copies, n_rows, n_agents // n_rows, -1).transpose(0, 1)
            outputs = mlp(self.layers, rows.reshape(n_rows, -1, n_inputs))
            actions = outputs.tanh() if self.squash else outputs.clamp(-1, 1)
        by_copy = actions.view(n_rows, n_copies, n_agents // n_rows, -1).transpose(0, 1)
        result: Float = by_copy.reshape(n_copies, n_agents, -1).numpy()
        if self.frame is not None:
            return np.clip(self.frame.to_world(observations, result), -1, 1).astype(np.float32)
        return result.astype(np.float32)
