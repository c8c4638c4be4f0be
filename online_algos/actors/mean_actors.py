"""Actors: the mean actions of K teams, and what trainings with such actors keep in checkpoints."""

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates, memories, next_memory
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import standardize, with_agent_id
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.online_algos.actors.sample_rows import sample_rows, sample_segments
from swarmdata.online_algos.collection.input_moments import InputMoments
from swarmdata.online_algos.collection.training_worlds import pack, unpack
from swarmdata.online_algos.continuation.offline_start import OfflineStart, load_actors
from swarmdata.perception.frames import Frame
from swarmdata.types import Bool, Float


class Actors:
    """The mean actions of K seeds' teams, from observations normalized by `moments`.

    They have two hidden layers of a width, and remember M = `memory_size` numbers for each robot;
    0: none. Gradients flow through the memories of segments of `window` steps. Robots that share an
    actor (`parameters`) see their number.
    """

    def __init__(
        self, sizes: Sizes, seeds: Sequence[int], hidden: int, parameters: Parameters,
        moments: InputMoments, memory_size: int = 0, window: int = 1,
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

    def start_from(self, start: OfflineStart, seeds: Sequence[int], frame: Frame | None) -> None:
        """Takes over an offline run's actors and input statistics; CheckpointError if unfit."""
        fitting = cast("TorchPolicy", self.policy(0, frame))
        load_actors(start, seeds, fitting, self.network)
        self.input_mean, self.input_std = start.moments(len(seeds))[:2]

    def copy(self) -> "Actors":
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
        """Mean actions, [K, E, N, A], and the memory after the step; no gradient.

        Inputs are those of `inputs`, [K, E, N, I]; memories, before and after, [K, E, N, M].
        """
        if isinstance(self.network, StackedMLP):
            return self.means(inputs), memory
        rows = by_network(inputs, self.parameters)
        after = next_memory(self.network.layers, rows, by_network(memory, self.parameters))
        outputs = self.network.read(rows, after)
        means, kept = (from_rows(x, inputs.shape, self.parameters) for x in (outputs, after))
        return means, kept

    def seen(self, inputs: Float, memories: Float, ended: Bool) -> list[Tensor]:
        """What actors saw in the segments of a rollout, [R, segments, ...], for `again`."""
        seen = sample_segments(torch.from_numpy(inputs), self.parameters, self.window)
        if not self.memory_size:
            return [seen]
        starts = np.zeros_like(ended)
        starts[1:] = ended[:-1]
        starts[:: self.window] = False  # there, the memory is what it was, empty or not
        by_robot = torch.from_numpy(starts)[..., None].expand(inputs.shape[:-1])
        begins = sample_segments(by_robot, self.parameters, self.window)
        return [
            seen,
            begins,
            sample_rows(torch.from_numpy(memories[:: self.window]), self.parameters),
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


def collection_state(run: Any) -> dict[str, Tensor]:
    """Inputs' statistics of a run's actors, its worlds, generators and joint steps, as copies."""
    return {
        **{f"worlds.{k}": v for k, v in run.worlds.state_dict().items()},
        "input.mean": torch.from_numpy(run.actors.input_mean.copy()),
        "input.std": torch.from_numpy(run.actors.input_std.copy()),
        "frames": torch.tensor(run.frames),
        "generators": pack([generator.bit_generator.state for generator in run.generators]),
    }


def restore_collection(run: Any, state: Mapping[str, Tensor]) -> None:
    """Restores what `collection_state` returned and begins new episodes."""
    run.actors.input_mean = state["input.mean"].numpy().copy()
    run.actors.input_std = state["input.std"].numpy().copy()
    run.frames = int(state["frames"])
    for generator, known in zip(run.generators, unpack(state["generators"]), strict=True):
        generator.bit_generator.state = known
    run.worlds.load_state_dict(part(state, "worlds"))
