"""A dataset for learners that are not ours, with exactly the inputs that ours get.

`swarmdata train` hands an algorithm batches of `framed(train split)`, which it normalizes with
`Normalizer`. A peer gets the same: observations and actions in the robots' frame, normalized
observations and states, rewards in units of the deviation of the team's returns-to-go. Its policy
is evaluated in the same frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from swarmdata import FunctionPolicy, Policy, TaskSpec, load
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import Normalizer
from swarmdata.learn.training.framed_dataset import framed
from swarmdata.perception.frames import in_world
from swarmdata.rollouts.task_frame import frame_of
from swarmdata.types import Batch, Double, Float, Int

DISCOUNT = 0.95
"""Of the returns-to-go whose deviation is the unit of rewards, as in our algorithms."""


@dataclass(frozen=True)
class Budget:
    """What every learner gets alike; everything else is as its authors set it."""

    n_updates: int = 4000
    batch_size: int = 128  # joint transitions
    units: int = 64  # of each of two hidden layers
    n_seeds: int = 3
    n_episodes: int = 256


class TeamData:
    """The train split of a dataset of one of our tasks.

    Attributes:
        id: of the dataset.
        spec: of the task.
        mean_return: of the recorded episodes.
        n_agents, n_observations, n_actions, n_states: sizes; observations have the frame's
            features.

    Args:
        dataset_id: as `swarmdata.load` takes it.
    """

    def __init__(self, dataset_id: str) -> None:
        dataset = load(dataset_id, progress=False)
        assert isinstance(dataset.spec, TaskSpec)
        self.id, self.spec = dataset_id, dataset.spec
        self.train = dataset.split("train")
        self.frame = frame_of(dataset.spec)
        self.mean_return = float(self.train.episodes.team_return.mean())
        data = framed(self.train, self.frame)
        self._sampler = data.sampler(1, seed=0)
        self._normalizer = Normalizer(Statistics.measure(data, DISCOUNT), "cpu")
        self._rows = self.train.sampler(1, seed=0).rows.valid  # whole episodes, one after another
        one = self._sampler.gather(self._rows[:1])
        self.n_agents, self.n_observations = one.observations.shape[1:]
        self.n_actions, self.n_states = one.actions.shape[2], one.states.shape[1]

    def draw(self, rng: np.random.Generator, n: int) -> Batch:
        """Returns `n` transitions drawn with replacement, float32 tensors [n, ...]."""
        return self._gather(self._rows[rng.integers(len(self._rows), size=n)])

    def windows(self, rng: np.random.Generator, n: int, length: int) -> Batch:
        """Returns `n` windows of consecutive steps, which may cross ends of episodes, [n, L, ...].

        So a buffer of one long stream draws them; `terminations` and `truncations` tell the ends.
        """
        first = rng.integers(len(self._rows) - length + 1, size=n)
        return self._gather(self._rows[first[:, None] + np.arange(length)])

    def _gather(self, index: Int) -> Batch:
        batch = self._sampler.gather(index).to_torch()
        known = self._normalizer
        return replace(
            batch,
            observations=known.observations(batch.observations),
            next_observations=known.observations(batch.next_observations),
            states=known.states(batch.states),
            next_states=known.states(batch.next_states),
            rewards=batch.rewards * known.reward_scale,
        )

    def inputs(self, observations: Float) -> Tensor:
        """Returns what a policy sees of observations [E, N, O], as in batches, float64."""
        framed_ = observations if self.frame is None else self.frame.inputs(observations)
        return self._normalizer.observations(torch.from_numpy(framed_)).double()

    def in_world(self, observations: Float, actions: Tensor) -> Double:
        """Returns a policy's actions [E, N, A] as the world takes them."""
        return in_world(self.frame, observations, actions.numpy().clip(-1.0, 1.0))

    def policy(self, act: Callable[[Tensor], Tensor]) -> Policy:
        """Returns a policy for our evaluator.

        Args:
            act: maps inputs, float64 [E, N, O], to actions [E, N, A]; it has no memory.
        """

        @torch.no_grad()
        def actions(observations: Float) -> Double:
            return self.in_world(observations, act(self.inputs(observations)))

        return FunctionPolicy(actions)
