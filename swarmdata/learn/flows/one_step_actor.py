"""One-step actors, students of a flow: they map a robot's observations and noise to an action."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor

from swarmdata.learn.flows.joint_flow import JointFlow
from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS, GatedShape, StackedGates
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.segments import learned, remembered_next
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import (
    Standardization,
    normal_like,
    uniform_like,
    with_agent_id,
)
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize, mlp
from swarmdata.learn.networks.setup import Setup
from swarmdata.types import Batch

Noise = Literal["team", "own"]
"""What a robot knows of the team's noise: its own and that of all, or its own alone."""

Redraw = Literal["episode", "step"]
"""When noise is drawn anew: at the start of every episode, or in every step."""


def noise_size(noise: Noise, n_agents: int, action_size: int) -> int:
    """Returns how many numbers of noise a robot's network sees."""
    return action_size * (1 if noise == "own" else 1 + n_agents)


def known_noise(values: Tensor, noise: Noise) -> Tensor:
    """Returns what each robot knows of the team's noise [..., N, A], [..., N, `noise_size`]."""
    if noise == "own":
        return values
    n_agents = values.shape[-2]
    team = values.flatten(-2)[..., None, :].expand(*values.shape[:-2], n_agents, -1)
    return torch.cat([values, team], -1)


@dataclass(frozen=True)
class FlowSettings(MemorySettings):
    """Settings of a joint flow and of the one-step actors that copy it."""

    flow_hidden: tuple[int, ...] = (64, 64)  # of one robot's part; students have the data's mean
    n_flow_steps: int = 10  # of Euler's method; Park et al. 2025; with 5, modes blur
    flow_learning_rate: float = 3e-3
    debiased: bool = True  # see `Distillation`; false copies the flow's mean too
    noise: Noise = "team"
    redraw: Redraw = "step"
    noise_scale: float = 1.0  # when acting; 1 samples the distribution of the data
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network


class StudentView(NamedTuple):
    """Transitions, and what one-step actors see of them besides noise."""

    batch: Batch  # fields [K, B, ...]
    features: Tensor  # normalized observations, with the memory if there is one, [K, B, N, F]


class OneStepActor:
    """Students of a `JointFlow`: mu(o_i, i, z), or mu(h_i, i, z) with a memory h_i, of K seeds.

    A robot's memory is that of a gated recurrent unit which sees its normalized observations and
    its number, as in `memory.recurrent_actor`. Noise does not enter it.
    """

    def __init__(self, setup: Setup, config: FlowSettings, hidden: tuple[int, ...]) -> None:
        self.sizes, self.config = setup.sizes, config
        n_seen = self.sizes.observation + self.sizes.n_agents
        n_inputs = n_seen + noise_size(config.noise, self.sizes.n_agents, self.sizes.action)
        self.network: StackedMLP | StackedGates
        if config.has_memory:
            reader = MLPShape(n_inputs + config.memory_size, hidden, self.sizes.action)
            shape = GatedShape(n_seen, config.memory_size, reader)
            self.network = StackedGates(shape, setup.n_seeds, setup.device)
        else:
            perceptron = MLPShape(n_inputs, hidden, self.sizes.action)
            self.network = StackedMLP(perceptron, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        self.standard = Standardization.of(setup.statistics, setup.device)

    def see(self, batch: Batch) -> StudentView:
        """Returns the transitions to learn from, and what the actors see of them.

        A batch is of transitions, [K, B, ...], or with a memory of windows, [K, B, L, ...], whose
        segments give B times their steps.
        """
        features = self.standard(batch.observations)
        if not isinstance(self.network, StackedGates):
            return StudentView(batch, features)
        steps, *known = learned(self.network, batch, features, self.config.window, "shared")
        return StudentView(steps, torch.cat(known, -1))

    @torch.no_grad()
    def see_next(self, view: StudentView) -> Tensor:
        """Returns what the actors see one step later, without a gradient, [K, B, N, F]."""
        after = self.standard(view.batch.next_observations)
        if not isinstance(self.network, StackedGates):
            return after
        memory = view.features[..., self.sizes.observation :]
        return torch.cat([after, remembered_next(self.network, after, memory, "shared")], -1)

    def __call__(self, features: Tensor, noise: Tensor) -> Tensor:
        """Returns actions, [K, B, N, A], in (-1, 1), of what actors see and the team's noise."""
        known = torch.cat([features, known_noise(noise, self.config.noise)], -1)
        first = N_GATE_LAYERS if isinstance(self.network, StackedGates) else 0
        outputs = mlp(self.network.layers[first:], with_agent_id(known).flatten(1, 2))
        return outputs.tanh().view_as(noise)


class Distillation:
    """Flows of the data and the actors that copy them, of K seeds, with an optimizer each.

    A student that copies samples F(c, z) alone copies the flow's errors and adds its own. So the
    targets are debiased: with the data's action a in the same row and independent noise z',

        T = F(c, z) + a - F(c, z')

    Given c and z, the mean of T is F(c, z) plus what the mean of the flow lacks of that of the
    data. The price is noise in the targets, twice the spread of the data.
    """

    def __init__(
        self, setup: Setup, config: FlowSettings, hidden: tuple[int, ...], *, learning_rate: float
    ) -> None:
        self.flow = JointFlow(setup, config.flow_hidden, config.n_flow_steps)
        self.actor = OneStepActor(setup, config, hidden)
        self._debiased = config.debiased
        self._descent = Descent(
            {"teacher": self.flow.network, "actor": self.actor.network}, setup.n_seeds,
            {"teacher": config.flow_learning_rate, "actor": learning_rate}, config.max_grad_norm,
        )  # fmt: skip
        self.state_dict = self._descent.state_dict

    def fit(
        self, x: Tensor, batch: Batch, generators: Sequence[torch.Generator], scale: float
    ) -> Tensor:
        """Moves the flow one step towards the joint actions of a batch; returns its loss, [K].

        x are normalized states and observations, [K, B, S + N O]; one generator for each seed draws
        noise and times; `scale` is a factor on the learning rate.
        """
        actions = batch.actions
        times = uniform_like(generators, actions[:, :, 0, :1])  # [K, B, 1]
        loss = self.flow.loss(x, actions, normal_like(generators, actions), times, batch.alive)
        self._descent.step_of("teacher", loss, scale)
        return loss

    def targets(
        self, x: Tensor, z: Tensor, batch: Batch, generators: Sequence[torch.Generator]
    ) -> Tensor:
        """Returns what the actors copy, T, without a gradient, [K, B, N, A]; draws the noise z'.

        x are normalized states and observations, [K, B, S + N O], of a batch; the noise z that the
        actors see is [K, B, N, A]; one generator for each seed draws z'.
        """
        actions, alive = batch.actions, batch.alive
        samples = self.flow.sample(x, z, alive)
        if not self._debiased:
            return samples
        return samples + actions - self.flow.sample(x, normal_like(generators, actions), alive)

    def step(self, loss: Tensor, scale: float) -> None:
        """Moves the actors down the sum over seeds of a loss [K]; `scale` is of their rate."""
        self._descent.step_of("actor", loss, scale)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone.

        Checkpoints of swarmdata 0.2 have another kind of flow, under another name. Their actors are
        read, for policies; their runs do not go on, since their settings lack `debiased`.
        """
        blank = {} if "teacher" in state else self.state_dict()
        kept = {name: tensor for name, tensor in blank.items() if name.startswith("teacher")}
        self._descent.load_state_dict({**kept, **state})
