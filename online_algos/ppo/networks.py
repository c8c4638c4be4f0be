"""The networks of MAPPO: the mean actions of K teams, and the values that judge them."""

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import (
    GatedShape,
    StackedGates,
    memories,
    next_memory,
)
from swarmdata.learn.networks.network_inputs import standardize, with_agent_id
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.collection.input_moments import Moments
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.ppo.rollout_samples import (
    Rollout,
    critic_states,
    pad_by_seed,
    ranks,
    sample_rows,
    sample_segments,
)
from swarmdata.perception.frames import Frame
from swarmdata.types import Double, Float, Step


class ValueScale:
    """Mean and standard deviation of the value targets of each seed, averaged over updates.

    Yu et al. 2022, section 5.1, value normalization.
    """

    def __init__(self, n_seeds: int, decay: float = 0.99) -> None:
        self.decay = decay
        self.moments: Double = np.zeros((3, n_seeds))  # weight, mean, mean square

    def update(self, targets: Float) -> None:
        """Takes in the targets of one rollout, [T, K, E, N]."""
        by_seed = targets.astype(np.float64).swapaxes(0, 1).reshape(targets.shape[1], -1)
        new = np.stack([np.ones(len(by_seed)), by_seed.mean(1), np.square(by_seed).mean(1)])
        self.moments = self.decay * self.moments + (1 - self.decay) * new

    @property
    def mean(self) -> Double:
        """Mean of past targets, [K]."""
        mean: Double = self.moments[1] / np.maximum(self.moments[0], 1e-8)
        return mean

    @property
    def std(self) -> Double:
        """Standard deviation of past targets, at least 0.01, [K]."""
        square = self.moments[2] / np.maximum(self.moments[0], 1e-8)
        deviation: Double = np.sqrt(np.maximum(square - self.mean**2, 1e-4))
        return deviation

    def normalize(self, targets: Float) -> Float:
        """Returns what the critic learns, [T, K, E, N]."""
        scaled = (targets - self.mean[:, None, None]) / self.std[:, None, None]
        return scaled.astype(np.float32)

    def denormalize(self, values: Float) -> Float:
        """Returns values in units of return, of a critic's outputs [..., K, E, N]."""
        scaled = values * self.std[:, None, None] + self.mean[:, None, None]
        return scaled.astype(np.float32)

    def tensor(self) -> Tensor:
        """The moments, for a checkpoint."""
        return torch.from_numpy(self.moments.copy())


class LearnedDeviation:
    """One standard deviation of each component of each actor's actions, the same in every state.

    (Schulman et al. 2017, section 6.1; the code of Yu et al. 2022.)
    """

    def __init__(self, n_rows: int, action_size: int, initial: float) -> None:
        # the logarithms, as networks without inputs; its rows are those of the actors
        self.network = StackedMLP(MLPShape(0, (), action_size), n_rows, "cpu")
        self.network.flat.fill_(math.log(initial))
        self._nothing = torch.zeros(n_rows, 1, 0)

    @property
    def std(self) -> Tensor:
        """The deviations, [R, 1, A], with the gradient of `network`."""
        return self.network(self._nothing).exp()

    @property
    def entropy(self) -> Tensor:
        """Entropy of each actor's noise, [R], in nats."""
        log_std = self.network(self._nothing)  # [R, 1, A]
        return (log_std + 0.5 * math.log(2 * math.pi * math.e)).sum((1, 2))


ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


class Actors:
    """The mean actions of K seeds' teams, from normalized observations.

    Args:
        sizes: numbers of robots and features.
        seeds: of the initial parameters, [K].
        hidden: width of the two hidden layers.
        parameters: whether the robots of a seed share an actor, which then sees their number.
        moments: of the observations.
        memory_size: numbers that each robot remembers, M; 0: actors without a memory.
        window: steps of the segments through whose memories gradients flow; 1 without a memory.
    """

    def __init__(
        self, sizes: Sizes, seeds: Sequence[int], hidden: int, parameters: Parameters,
        moments: Moments, memory_size: int = 0, window: int = 1,
    ) -> None:  # fmt: skip
        self.parameters, self.memory_size, self.window = parameters, memory_size, window
        self.n_rows = 1 if parameters == "shared" else sizes.n_agents  # actors of each seed
        n_inputs = sizes.observation + (sizes.n_agents if parameters == "shared" else 0)
        shape = MLPShape(n_inputs, (hidden, hidden), sizes.action)
        n_networks = len(seeds) * self.n_rows
        self.network: StackedMLP | StackedGates = (
            StackedGates(GatedShape.reading(shape, memory_size), n_networks, "cpu")
            if memory_size
            else StackedMLP(shape, n_networks, "cpu")
        )
        initialize(self.network, seeds, ACTOR_STREAM, method="orthogonal", head_gain=0.01)
        self.input_mean, self.input_std = moments.observation_mean, moments.observation_std

    def load(self, others: "Actors") -> None:
        """Replaces the weights and input statistics by copies of others'."""
        self.network.load(others.network.flat)
        self.input_mean, self.input_std = others.input_mean.copy(), others.input_std.copy()

    def copy(self) -> "Actors":
        """Returns actors with equal weights in memory of their own."""
        twin = copy(self)
        twin.network = self.network.clone()
        twin.input_mean, twin.input_std = self.input_mean.copy(), self.input_std.copy()
        return twin

    def inputs(self, observations: Float) -> Tensor:
        """Normalized observations, [K, E, N, I]; with the robot's number if they share an actor."""
        moments = (self.input_mean, self.input_std)  # float64 of an offline run
        mean, std = (torch.from_numpy(m).float()[:, None, None] for m in moments)
        features = standardize(torch.from_numpy(observations), mean, std)
        return with_agent_id(features) if self.parameters == "shared" else features

    def means(self, inputs: Tensor) -> Tensor:
        """Mean actions without a memory and gradient, [K, E, N, A], of inputs [K, E, N, I]."""
        assert isinstance(self.network, StackedMLP)  # `StartConfig` is refused with a memory
        with torch.no_grad():
            outputs = self.network(by_network(inputs, self.parameters))
        return from_rows(outputs, inputs.shape, self.parameters)

    @torch.no_grad()
    def act(self, inputs: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Mean actions, [K, E, N, A], and the memory after the step, [K, E, N, M]; no gradient."""
        if isinstance(self.network, StackedMLP):
            return self.means(inputs), memory
        rows = by_network(inputs, self.parameters)
        after = next_memory(self.network.layers, rows, by_network(memory, self.parameters))
        outputs = self.network.read(rows, after)
        means, kept = (from_rows(x, inputs.shape, self.parameters) for x in (outputs, after))
        return means, kept

    def seen(self, r: Rollout) -> list[Tensor]:
        """What actors saw in the segments of a rollout, [R, segments, ...], for `again`."""
        inputs = sample_segments(torch.from_numpy(r.actor_inputs), self.parameters, self.window)
        if not self.memory_size:
            return [inputs]
        starts = np.zeros_like(r.ended)
        starts[1:] = r.ended[:-1]
        starts[:: self.window] = False  # there, the memory is what it was, empty or not
        by_robot = torch.from_numpy(starts)[..., None].expand(r.log_probs.shape)
        memory = torch.from_numpy(r.memories[:: self.window])
        return [
            inputs,
            sample_segments(by_robot, self.parameters, self.window),
            sample_rows(memory, self.parameters),
        ]

    def again(self, inputs: Tensor, *remembered: Tensor) -> Tensor:
        """Mean actions, [R, B L, A], of segments of inputs [R, B, L, I].

        With a memory, `remembered` is whether episodes begin, [R, B, L], and the memory before the
        first step as it was when the rollout was made, [R, B, M].
        """
        flat = inputs.flatten(1, 2)
        if isinstance(self.network, StackedMLP):
            return self.network(flat)
        starts, first = remembered
        by_time = inputs.transpose(1, 2), starts.transpose(1, 2)
        history = memories(self.network.layers, *by_time, first)  # [R, L, B, M]
        return self.network.read(flat, history.transpose(1, 2).flatten(1, 2))

    def policy(self, index: int, frame: Frame | None) -> TorchPolicy | RecurrentPolicy:
        kind = RecurrentPolicy if self.memory_size else TorchPolicy
        return kind(
            layers=self.network.extract(index * self.n_rows, torch.float64, self.n_rows),
            observation_mean=torch.from_numpy(self.input_mean[index].astype(np.float64)),
            observation_std=torch.from_numpy(self.input_std[index].astype(np.float64)),
            squash=False,
            frame=frame,
            parameters=self.parameters,
        )


class Critic:
    """The values of K seeds, from a robot's inputs and its view of the state."""

    def __init__(self, n_inputs: int, seeds: Sequence[int], hidden: int) -> None:
        self.network = StackedMLP(MLPShape(n_inputs, (hidden, hidden), 1), len(seeds), "cpu")
        initialize(self.network, seeds, CRITIC_STREAM, method="orthogonal", head_gain=1.0)
        self.scale = ValueScale(len(seeds))

    def values(self, actor_inputs: Tensor, states: Tensor) -> Float:
        """Values in units of return, [T, K, E, N], of inputs [T, K, E, N, ...]; no gradient."""
        t, k, e, n = actor_inputs.shape[:4]
        with torch.no_grad():
            rows = self.network(sample_rows(torch.cat([actor_inputs, states], -1), "shared"))
        return self.scale.denormalize(rows.view(k, t, e, n).transpose(0, 1).numpy())


def fill_values(
    rollout: Rollout, ends: Sequence[Step], worlds: Worlds, actors: Actors, critic: Critic
) -> None:
    """Writes `values` and `next_values` of a rollout whose other fields are written.

    `ends` are, for each step, the last steps of the episodes that ended in it; `worlds` are in the
    step after the rollout.
    """
    r = rollout
    r.values[:] = critic.values(torch.from_numpy(r.actor_inputs), torch.from_numpy(r.states))
    inputs = actors.inputs(worlds.observations(worlds.current_step))[None]
    states = torch.from_numpy(worlds.grouped(critic_states(worlds.current_step)))[None]
    r.next_values[:] = np.concatenate([r.values[1:], critic.values(inputs, states)])
    t, k, e = np.nonzero(r.ended)
    if len(t):
        last = Step._make(map(np.concatenate, zip(*ends, strict=True)))
        inputs = actors.inputs(pad_by_seed(worlds.local_observations(last), k, worlds.n_seeds))
        states = torch.from_numpy(pad_by_seed(critic_states(last), k, worlds.n_seeds))
        r.next_values[t, k, e] = critic.values(inputs[None], states[None])[0][k, ranks(k)]
