"""RecurrentFlowPolicy, a `FlowPolicy` whose robots remember the running episode."""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS
from swarmdata.learn.networks.team_networks import Parameters, answer
from swarmdata.learn.policies.flow_policy import Noise, Redraw, drawn_noise, known_noise
from swarmdata.learn.policies.recurrent_policy import Remembering
from swarmdata.perception.frames import Frame
from swarmdata.types import Double, Step


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecurrentFlowPolicy(Remembering):
    """Robots turn noise into actions, given all normalized observations of an episode so far.

    The noise is that of a `FlowPolicy`.

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

    n_agents: int
    noise: Noise
    redraw: Redraw
    noise_scale: float = 1.0
    frame: Frame | None = None
    uses_state: bool = False

    @property
    def view(self) -> tuple[Frame | None, Parameters]:
        return self.frame, "shared"

    def draw(self, step: Step) -> Double:
        """Returns the noise of all robots, normal of deviation `noise_scale`, [E, N, A]."""
        size = self.layers[-1].weight.shape[-1]
        return self.noise_scale * drawn_noise(step, self.n_agents, size, self.redraw)

    def local_actions(self, step: Step, features: Tensor, memory: Tensor) -> Tensor:
        noise = known_noise(torch.from_numpy(self.draw(step)), self.noise)
        known = torch.cat([features, memory, noise], -1)
        return answer(self.layers[N_GATE_LAYERS:], known, "shared").tanh()
